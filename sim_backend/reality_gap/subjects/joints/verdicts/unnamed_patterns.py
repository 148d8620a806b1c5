"""Laws that nobody wrote down: what is left of a joint's torque with the causes in the model, as a function of what it follows.

A magnet, a tight spot or a belt are in no catalogue, and each of them looks a little like a friction or a spring: with that one
in the model half of the error may be gone. What is left then is no noise: it follows the position, the way since the joint
turned round, or the torque of a neighbour. A function of these is a law if it foretells what it was not fitted to.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.identification import LEAST_TORQUE_SHARE, JointStudy
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import BEYOND_NOISE, VARIABLES, hats, variables_of
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_effects import effects_judged
from sim_backend.reality_gap.verdict import Verdict, VerdictKind

_MOST = 0.5
"""Share of the variance of what is left that a function must foretell to be its law."""
_BEYOND_SENSORS = 2.0
"""Times what sensors and smoothing make of torques: what is less is no pattern."""
_WIDTHS = (0.03, 0.1, 0.3, 1.0)
"""Ways over which a friction with a memory turns round, in standard deviations of the position."""
_PARTS = 5
"""Into which each recording is cut: what is left in each of them is foretold by a function fitted to all others."""


@dataclass(frozen=True)
class UnnamedPattern:
    """What is left at a joint follows something: the joint's name, what it follows, and the share of the variance."""

    joint: str
    variable: str
    share: float


def against_patterns(verdict: Verdict, study: JointStudy, selection: RolloutSelection, drawn_rad: np.ndarray) -> Verdict:
    """A verdict of rollouts as it stands beside what is left: where that has a law of its own, causes are a part of it.

    Only joints are asked that still end up further off than robots which were drawn with the causes, with all that the extended
    model has, by no margin: a pattern tells even so.

    Args:
        verdict: what rollouts came to.
        study: of the same recordings.
        selection: that the verdict was drawn from.
        drawn_rad: what usual windows of robots that have the causes and are healthy else are off, shape (k,), or noise if more.
    """
    if verdict.verdict not in (VerdictKind.NAMED, VerdictKind.CONFUSABLE):
        return verdict
    is_far, names, episodes = selection.extended.usual_rad > drawn_rad, study.problem.names, study.problem.episodes
    model, without = selection.extended.state, selection.nominal.state
    found = [followed(episodes, model, int(j), names, instead_of=without) for j in np.flatnonzero(is_far)]
    laws = sorted((law for law in found if law is not None), key=lambda law: -law.share)
    if not laws:
        return verdict
    first = laws[0]
    summary = (
        f"What is found explains a part of it: what is left at {first.joint} follows {first.variable}, by a law that the "
        "catalogue lacks."
    )
    return replace(
        verdict,
        verdict=VerdictKind.UNEXPLAINED,
        summary=summary,
        follows=(*(f"{law.variable} ({law.joint}; {law.share:.0%} of what is left)" for law in laws), *verdict.follows),
        effects=tuple(effects_judged(selection, VerdictKind.UNEXPLAINED, verdict.causes, ())),
    )


def followed(
    episodes: Sequence[EpisodeEquations],
    state: JointState,
    joint: int,
    names: Sequence[str],
    instead_of: JointState | None = None,
) -> UnnamedPattern | None:
    """What a joint's torque error with a model follows most, if that takes most of its variance and sensors do not make it.

    Args:
        episodes: of a study.
        state: the model.
        joint: index.
        names: of all joints.
        instead_of: the model without causes, beside which a function alone may leave less than the causes do.
    """
    rows = [episode.valid_mechanics[:, joint] for episode in episodes]
    if not any(own.any() for own in rows):
        return None
    torque = np.concatenate([e.path.averaged(e.driving_nm[joint])[own] for e, own in zip(episodes, rows, strict=True)])
    floor_nm = float(np.sqrt(np.mean([e.torque_error_floor_nm[joint] ** 2 for e in episodes])))
    usual_nm = max(floor_nm, LEAST_TORQUE_SHARE * float(np.sqrt(np.mean(torque**2))))
    left = _error_nm(episodes, state, joint, rows)
    if float(np.sqrt(np.mean(left**2))) <= _BEYOND_SENSORS * usual_nm:
        return None
    part = np.concatenate([np.arange(own.sum()) * _PARTS // max(1, int(own.sum())) for own in rows])
    errors = [left, *([] if instead_of is None else [_error_nm(episodes, instead_of, joint, rows)])]
    found = {
        name: 1.0 - min(foretold_nm2(error, columns, part) for error in errors) / float(np.mean(left**2))
        for name, columns in (_of_one(episodes, joint, rows) | _of_several(episodes, joint, rows, names)).items()
    }
    variable, share = max(found.items(), key=lambda each: each[1])
    return UnnamedPattern(names[joint], variable, share) if share > _MOST else None


def _error_nm(episodes: Sequence[EpisodeEquations], state: JointState, joint: int, rows: Sequence[np.ndarray]) -> np.ndarray:
    """A joint's torque error with a model in the rows that count, but for when within a row a torque acts: nobody knows that."""
    pairs = list(zip(episodes, rows, strict=True))
    error = np.concatenate([e.torque_error(state)[own, joint] for e, own in pairs])
    later = np.concatenate([_later_nm(e, joint)[own] for e, own in pairs])
    beside = np.stack([later, np.ones_like(later)], axis=1)
    return error - beside @ np.linalg.lstsq(beside, error, rcond=None)[0]


def _later_nm(episode: EpisodeEquations, joint: int) -> np.ndarray:
    """How a joint's torque changes when it, or the targets that it was made of, come later, shape (r,)."""
    of_targets = episode.later_targets_nm(joint)
    if of_targets is None:
        return np.gradient(episode.path.averaged(episode.driving_nm[joint]))
    return episode.path.averaged(of_targets)


def foretold_nm2(error: np.ndarray, columns: np.ndarray, part: np.ndarray) -> float:
    """Mean square of an error that is left where a function foretells it that was fitted elsewhere.

    Args:
        error: shape (r,), N m.
        columns: whose sum is the function, shape (r, m).
        part: of the recordings that each row is of, shape (r,).
    """
    left = error.copy()
    for each in np.unique(part):
        seen = part != each
        left[~seen] -= columns[~seen] @ np.linalg.lstsq(columns[seen], error[seen], rcond=None)[0]
    return float(np.mean(left**2))


def _of_one(episodes: Sequence[EpisodeEquations], joint: int, rows: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Functions of one variable each, as columns over the counted rows of all episodes."""
    variables, found = [variables_of(episode) for episode in episodes], {}
    for name in VARIABLES:
        series = np.concatenate([v[name][0][own, joint] for v, own in zip(variables, rows, strict=True)])
        found[f"its {name}"] = hats(series, BEYOND_NOISE * max(float(v[name][1][joint]) for v in variables))
    return found


def _of_several(
    episodes: Sequence[EpisodeEquations], joint: int, rows: Sequence[np.ndarray], names: Sequence[str]
) -> dict[str, np.ndarray]:
    """Functions of several variables at once, each as columns over the counted rows of all episodes."""
    pairs = list(zip(episodes, rows, strict=True))
    position = np.concatenate([e.path.position[own, joint] for e, own in pairs])
    noise_rad = BEYOND_NOISE * max(float(e.path.position_noise_rad[joint]) for e in episodes)
    torque = np.concatenate([e.path.averaged(e.driving_nm).T[own] for e, own in pairs])
    since = np.concatenate([way_since_reversal_rad(e.path.position[:, joint], noise_rad)[own] for e, own in pairs])
    by_place, there, back = hats(position, noise_rad), (since > 0.0)[:, None], (since <= 0.0)[:, None]
    spread = float(position.std())
    bends = [np.concatenate([bend(e.path.position[:, joint], share * spread)[own] for e, own in pairs]) for share in _WIDTHS]
    found = {
        "the way that it came, as friction with a memory": np.stack(bends, axis=1),
        "its position, there and back": np.hstack([by_place * there, by_place * back]),
        "its way since it turned round": hats(since, noise_rad),
    }
    return found | {f"the torque of {name}": hats(torque[:, i], 0.0) for i, name in enumerate(names) if i != joint}


def bend(position_rad: np.ndarray, width_rad: float) -> np.ndarray:
    """How far a friction with a memory is bent, from -1 to 1: it turns round exponentially over a width; shapes (t,)."""
    found, bent = np.zeros_like(position_rad), 0.0
    for i, step in enumerate(np.diff(position_rad), start=1):
        side = np.sign(step)
        bent = side + (bent - side) * np.exp(-abs(step) / width_rad)
        found[i] = bent
    return found


def way_since_reversal_rad(position_rad: np.ndarray, least_rad: float) -> np.ndarray:
    """How far a joint is from where it last turned round, with the sign of its direction; shapes (t,).

    Args:
        position_rad: of one joint.
        least_rad: a way back that counts as turning round.
    """
    found, turned, furthest, side = np.empty_like(position_rad), position_rad[0], position_rad[0], 0.0
    for i, place in enumerate(position_rad):
        if side * (place - furthest) >= 0.0:
            furthest, side = place, side or np.sign(place - turned)
        elif abs(place - furthest) > least_rad:
            turned, furthest, side = furthest, place, -side
        found[i] = place - turned
    return found
