"""Identification from tosses of an object: friction, contacts, size, gravity and the measurement's scale."""
