"""Weights, graphs and logs, kept under their SHA-256."""
