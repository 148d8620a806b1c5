"""Torques along the recorded motion: equations that a healthy robot fulfils, and the causes that explain what they leave."""
