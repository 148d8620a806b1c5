"""Housekeeping: retention of logs, backup, restore and checks of a farm's folder."""
