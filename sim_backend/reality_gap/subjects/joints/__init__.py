"""Identification of causes at joints: equations of a healthy robot, terms of each effect, fit and verdict."""
