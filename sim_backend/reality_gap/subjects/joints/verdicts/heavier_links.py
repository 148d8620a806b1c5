"""Torques that seem to be in another unit may only be larger than the model's because a link carries more than the model says."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.verdicts.readings import (
    FEWEST_ROWS,
    ToldEpisode,
    all_rows,
    errors_of,
    free_columns,
)
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import FALLS_TO, Misreading

_LIGHTEST, _ROUNDED = 1.0 / 30.0, 1e-6
"""Share of torques that a model may take of those of a robot: nobody overlooks a load that makes them larger by more.
And share of a load's largest torque that is nothing but rounding."""


def or_heavier_link(found: Misreading, data: Sequence[ToldEpisode], names: Sequence[str]) -> Misreading:
    """A reading of torques that are smaller than told, beside one link with more mass, or only that link if it does far better.

    More of the mass that the link has is asked for first, then a load that sits anywhere on it. That has as many numbers as the
    motion of a single joint shows: it is said alone only where it does far better at several.

    Args:
        found: a reading.
        data: as it is told.
        names: of the joints.
    """
    factors = np.abs(found.reading.torques)
    scaled = np.flatnonzero((factors < 1.0) & np.isfinite(found.after_nm))
    if not len(scaled) or (found.reading.positions != 1.0).any() or (found.reading.torques < 0.0).any():
        return found
    if factors[scaled].min() < _LIGHTEST:
        return found
    known = np.isfinite(found.after_nm)
    by_unit = found.after_nm / factors  # as a share of the torques as they are told
    told_nm = errors_of(all_rows(data))
    for images in (_by_mass(data), _by_load(data)):
        is_mass = images[0].shape[-1] == 1
        for link, name in enumerate(names):
            own = [of_all[:, :, link] for of_all in images]
            more, left = left_with(data, own)
            is_nearer = (left <= by_unit / FALLS_TO)[known].all() and (left <= FALLS_TO * told_nm)[scaled].all()
            if (is_mass and more[0] <= 0.0) or not is_nearer:
                continue
            said = f"what {name} moves is {1.0 + more[0]:.2g} times as heavy as in the model"
            said, check = said if is_mass else f"{name} carries a load that the model lacks", f"the mass that {name} carries"
            largest = np.max([np.abs(each).max(axis=(0, 2)) for each in own], axis=0)
            shows_at = known & (largest > _ROUNDED * largest.max())
            if (is_mass or shows_at.sum() > 1) and (left <= FALLS_TO * by_unit)[scaled].all():
                return replace(found, said=said, check=f"{check} in the model, and what is told of torques")
            return replace(found, said=f"{found.said}, or {said}", check=f"{found.check}, or {check},")
    return found


def _by_mass(data: Sequence[ToldEpisode]) -> list[np.ndarray]:
    """Torques by a factor of each link, of each episode, shape (t, k, k, 1), N m."""
    return [told.episode.dynamics.by_link_mass[..., None] for told in data]


def _by_load(data: Sequence[ToldEpisode]) -> list[np.ndarray]:
    """Torques by mass, inertia and centre of each link, which together are a load anywhere on it; shapes (t, k, k, 5), N m."""
    found = []
    for told, by_mass in zip(data, _by_mass(data), strict=True):
        path = told.episode.path
        shape = told.episode.plant.link_derivatives(path.position, path.velocity, path.acceleration)
        found.append(np.concatenate([by_mass, shape.by_inertia[..., None], shape.by_centre], axis=-1))
    return found


def left_with(data: Sequence[ToldEpisode], images: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """How much of p images, shapes (t, k, p), agrees best, shape (p,), and what joints then leave, (k,), N m; NaN of few rows."""
    joints: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for j in range(data[0].given.shape[1]):
        counts = [told.episode.valid_mechanics[:, j] for told in data]
        if sum(map(np.count_nonzero, counts)) < FEWEST_ROWS:
            continue
        error, image, velocity = (
            np.concatenate([values[rows, j] for values, rows in zip(of_episodes, counts, strict=True)])
            for of_episodes in (
                [told.given - told.needed for told in data],
                images,
                [told.episode.path.velocity for told in data],
            )
        )
        free = free_columns(velocity)
        joints[j] = _beside(error, free), _beside(image, free)
    weights = {j: 1.0 / max(float(np.linalg.norm(error)), 1e-6) for j, (error, _) in joints.items()}
    by_more = np.concatenate([weights[j] * image for j, (_, image) in joints.items()])
    wanted = np.concatenate([weights[j] * error for j, (error, _) in joints.items()])
    more, left = np.linalg.lstsq(by_more, wanted, rcond=None)[0], np.full(data[0].given.shape[1], np.nan)
    for j, (error, image) in joints.items():
        left[j] = np.sqrt(np.mean((error - image @ more) ** 2))
    return more, left


def _beside(values: np.ndarray, free: np.ndarray) -> np.ndarray:
    """What friction and a constant do not explain of it."""
    return values - free @ np.linalg.lstsq(free, values, rcond=None)[0]
