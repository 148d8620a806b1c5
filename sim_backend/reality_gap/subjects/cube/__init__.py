"""Identification of causes at the cube and its tracker from logs of pushes and rest."""
