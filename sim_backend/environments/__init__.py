"""Environments for training: one robot for Gymnasium, many at once for stable-baselines3."""
