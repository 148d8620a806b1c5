"""Robots that practise a task: one for Gymnasium, many at once for training."""
