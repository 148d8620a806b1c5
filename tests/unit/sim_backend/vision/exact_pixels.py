"""Pixels of a cube alone in the world as exact cameras would tell them: no part of the tracker."""

import numpy as np

from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.lessons import directions, on_faces
from sim_backend.vision.seen_pixels import STRIDE, SeenPixels

HALF_M = 0.0325


def exact_pixels(position_m, rotation, rng=None, noise=0.0, wrong=0.0):
    """One :class:`SeenPixels` for each nominal camera, with noise of the places and a share of wrong ones."""
    seen = []
    for calibration in nominal_calibrations():
        eye = (calibration.position_world_m - position_m) @ rotation / HALF_M
        direction = (directions(calibration) @ rotation / HALF_M)[::STRIDE, ::STRIDE]
        face, place = np.zeros(direction.shape[:2], int), np.zeros(direction.shape)
        for number in range(1, 7):
            axis, sign = (number - 1) // 2, 1 - 2 * ((number - 1) % 2)
            point = on_faces(np.full(face.shape, number), eye, direction)
            hit = (np.abs(point).max(axis=-1) <= 1 + 1e-9) & (eye[axis] * sign > 1)
            face[hit], place[hit] = number, point[hit]
        rows, columns = np.nonzero(face)
        found = place[rows, columns]
        if rng is not None:
            found = found + rng.normal(0, noise, found.shape)
            bad = rng.random(len(found)) < wrong
            found[bad] = rng.uniform(-1, 1, (bad.sum(), 3))
        pixel = STRIDE * np.stack([columns, rows], axis=1).astype(float)
        seen.append(SeenPixels(pixel, face[rows, columns] - 1, found, np.full(len(rows), max(noise, 0.02))))
    return seen
