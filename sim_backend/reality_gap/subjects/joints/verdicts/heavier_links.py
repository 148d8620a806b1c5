"""Torques that seem to be in another unit may only be larger than the model's because a link carries more than the model says."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.verdicts.readings import FEWEST_ROWS, ToldEpisode, free_columns, rms_left
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import FALLS_TO, Misreading


def or_heavier_link(found: Misreading, data: Sequence[ToldEpisode], names: Sequence[str]) -> Misreading:
    """A reading of torques that are smaller than told, beside one link with more mass, or only that link if it does far better.

    Args:
        found: a reading.
        data: as it is told.
        names: of the joints.
    """
    factors = np.abs(found.reading.torques)
    scaled = np.flatnonzero((factors < 1.0) & np.isfinite(found.after_nm))
    if not len(scaled) or (found.reading.positions != 1.0).any() or (found.reading.torques < 0.0).any():
        return found
    by_unit = (found.after_nm / factors)[scaled]  # as a share of the torques as they are told
    for link, name in enumerate(names):
        more, left = _with_more_mass(data, link)
        if more <= 0.0 or not (left[scaled] <= by_unit / FALLS_TO).all():
            continue
        said, check = f"what {name} moves is {1.0 + more:.2g} times as heavy as in the model", f"the mass that {name} carries"
        if (left[scaled] <= FALLS_TO * by_unit).all():
            return replace(found, said=said, check=f"{check} in the model, and what is told of torques")
        return replace(found, said=f"{found.said}, or {said}", check=f"{found.check}, or {check},")
    return found


def _with_more_mass(data: Sequence[ToldEpisode], link: int) -> tuple[float, np.ndarray]:
    """By which share more of a link's mass agrees best, and what joints then leave, shape (k,), N m; NaN of too few rows."""
    k = data[0].given.shape[1]
    errors, images = [], []
    for j in range(k):
        counts = [told.episode.valid_mechanics[:, j] for told in data]
        error, image, velocity = (
            np.concatenate([values[rows] for values, rows in zip(of_episodes, counts, strict=True)])
            for of_episodes in (
                [(told.given - told.needed)[:, j] for told in data],
                [told.episode.dynamics.by_link_mass[:, j, link] for told in data],
                [told.episode.path.velocity[:, j] for told in data],
            )
        )
        enough, free = len(error) >= FEWEST_ROWS, free_columns(velocity)
        errors.append(_beside(error, free) if enough else np.zeros(0))
        images.append(_beside(image, free) if enough else np.zeros(0))
    weights = [1.0 / max(float(error @ error), 1e-12) for error in errors]
    cross = sum(w * float(error @ image) for w, error, image in zip(weights, errors, images, strict=True))
    square = sum(w * float(image @ image) for w, image in zip(weights, images, strict=True))
    more = cross / square if square > 0.0 else 0.0
    left = [np.sqrt(np.mean((e - more * i) ** 2)) if len(e) else np.nan for e, i in zip(errors, images, strict=True)]
    return more, np.array(left)


def _beside(values: np.ndarray, free: np.ndarray) -> np.ndarray:
    """What friction and a constant do not explain of it."""
    return values - free @ rms_left(values, free)[1]
