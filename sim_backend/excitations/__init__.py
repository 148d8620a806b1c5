"""Excitations: motions that make a robot's physics identifiable."""
