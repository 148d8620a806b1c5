"""Identification of causes at joints, from recordings to a verdict.

``subject`` is the seam to a study. Each room below it imports only from those after it:

- ``verdicts``: what is said;
- ``identification`` and ``gain``: what was found, and what that bought;
- ``rollouts``: does the model go where the robot went? ``signs``: what shows without a fit;
- ``torques``: equations along the recorded motion;
- ``laws``: the model, and what each effect does to it.
"""
