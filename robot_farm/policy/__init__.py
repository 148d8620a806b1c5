"""A policy in a jailed process of its own, and the built-in ones."""
