"""Logs of trials: channels, messages, writer and reader. Imports none of the programs."""
