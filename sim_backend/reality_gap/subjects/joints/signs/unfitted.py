"""What joints show without a fit, found before it: where it acts, the mechanics counts in no fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FELT, TAKES_OVER, Sign
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.signs.checks import (
    Finding,
    end_findings,
    fault_findings,
    noisy_motors,
    torque_noise_findings,
)
from sim_backend.reality_gap.subjects.joints.signs.lost_rows import MOST_PLACES, lost_rows
from sim_backend.reality_gap.subjects.joints.signs.rattling import Rattling, rattling_joints
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations, equations_of
from sim_backend.reality_gap.subjects.joints.torques.fit import MANY_CAUSES
from sim_backend.reality_gap.subjects.joints.torques.look import JointProblem


@dataclass(frozen=True)
class Unfitted:
    """What was told before any fit.

    Attributes:
        episodes: with their rows that count; those of encoders that jumped are as if they had not.
        faults: joints that do not move, and encoders that jump.
        rattling: joints whose rotor rattles; their mechanics is in no fit.
    """

    episodes: Sequence[EpisodeEquations]
    faults: tuple[Finding, ...]
    rattling: tuple[Rattling, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All of them."""
        return (*self.faults, *(each.finding for each in self.rattling))

    @property
    def taken_over(self) -> frozenset[str]:
        """Effects that a fit would name for what is told already."""
        return frozenset(TAKES_OVER[fault.sign] for fault in self.faults if fault.sign in TAKES_OVER)


def told_without_fit(
    plant: Plant, recordings: Sequence[Recording], episodes: Sequence[EpisodeEquations], robot: Robot, start: JointState
) -> Unfitted:
    """Look for jumps, joints that rest, rotors that rattle, and ends that are elsewhere; let none of it count in a fit.

    Args:
        plant: of the nominal model.
        recordings: of the episodes.
        episodes: as recorded.
        robot: what is known of it; of a robot whose rotors and ends are not, only faults are looked for.
        start: the nominal model.
    """
    episodes, is_trifinger = list(episodes), isinstance(robot, KnownTriFinger)
    rattling = rattling_joints(episodes, start) if is_trifinger else []
    loose = {each.joint for each in rattling}  # a rotor's hit is no jump of its encoder
    if not is_trifinger:
        recordings = [_torn(recording, episode) for recording, episode in zip(recordings, episodes, strict=True)]
        for index in (index for index, each in enumerate(recordings) if each.joints is not None and each.joints.torn_s):
            episodes[index] = equations_of(plant, recordings[index], index, robot)
    found = fault_findings(episodes, size=None if is_trifinger else start.size)
    faults = tuple(fault for fault in found if fault.joint not in loose and not _is_in_tatters(fault, episodes))
    for index, corrected in _without_jumps(recordings, faults).items():
        episodes[index] = equations_of(plant, corrected, index, robot, reported=recordings[index].joints)
    for fault in faults:
        if fault.sign is not Sign.POSITION_JUMP and fault.joint is not None:
            for episode in episodes:
                episode.ignore_joint(fault.joint)
    for each in rattling:
        for episode, apart in zip(episodes, each.apart, strict=True):
            episode.ignore_rattling(each.joint, apart)
    for end in end_findings(episodes, start) if is_trifinger else ():
        for episode in episodes:
            episode.keep_off(end.joint or 0, 1 if end.sign is Sign.UPPER_END else 0, end.value)
    return Unfitted(episodes, faults, tuple(rattling))


def noise_of_motors(problem: JointProblem, state: JointState) -> list[Finding]:
    """Noise of single motors that their joints feel; their mechanics is then left out, since it would explain the noise."""
    odd = noisy_motors(problem.episodes, state) if isinstance(problem.robot, KnownTriFinger) else []
    if not odd:
        return []
    look = problem.look(state, ())
    if look.noise_ratio.max() > MANY_CAUSES:
        return []
    found = torque_noise_findings(problem.episodes, state, look.sensed_share, look.sensed_error)
    felt = [f for f in found if f.sign in FELT and f.joint in odd]
    for finding in felt:
        for episode in problem.episodes:
            episode.ignore_joint(finding.joint or 0)
    return felt


def _torn(recording: Recording, episode: EpisodeEquations) -> Recording:
    """A recording of which nothing is known where rows are missing, so that nothing is judged across it."""
    joints = episode.path.joints
    if not (places := lost_rows(joints.position_rad, episode.path.encoder_step_rad)):
        return recording
    position_rad = joints.position_rad.copy()
    for place in places:
        position_rad[place - 1 : place + 1] = np.nan
    when_s = tuple(float(recording.time_s[place]) for place in places)
    return replace(recording, joints=replace(joints, position_rad=position_rad, torn_s=when_s))


def _is_in_tatters(fault: Finding, episodes: Sequence[EpisodeEquations]) -> bool:
    """Whether a jump is of a recording that lacks rows at more places than were looked for."""
    return fault.sign is Sign.POSITION_JUMP and len(episodes[fault.episode].path.joints.torn_s) >= MOST_PLACES


def _without_jumps(recordings: Sequence[Recording], faults: Sequence[Finding]) -> dict[int, Recording]:
    """Recordings as their encoders would have reported them without losing counts, by index; only those with jumps."""
    corrected: dict[int, Recording] = {}
    for jump in faults:
        if jump.sign is not Sign.POSITION_JUMP:
            continue
        recording = corrected.get(jump.episode, recordings[jump.episode])
        assert recording.joints is not None and jump.joint is not None
        position = recording.joints.position_rad.copy()
        position[jump.sample :, jump.joint] -= jump.value
        corrected[jump.episode] = replace(recording, joints=replace(recording.joints, position_rad=position))
    return corrected
