"""Simulates a trial's log again beside its truth, in a child process that alone loads physics."""
