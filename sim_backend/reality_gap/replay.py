"""Replays recordings with an extended model as it lies on disk: how far does it go from where the robot went?

Recordings are those of a study file, best ones that no study has seen. Each is simulated in the loop in which it was made:
where it is known what turned position targets into torque that law acts on the simulated motion, otherwise the torques that
were sent do, or those that were measured where nobody knows what was sent. The model is what any MuJoCo program would load:
``extended-model.xml``, stepped one by one with ``extended_laws.Laws``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.measured.foreign.episodes import read_recordings
from sim_backend.reality_gap.measured.foreign.study_file import load_study_file
from sim_backend.reality_gap.model.extended_laws import Laws
from sim_backend.reality_gap.model.files import LAWS, NATIVE
from sim_backend.reality_gap.model.native_elements import PLAY_SUFFIX
from sim_backend.reality_gap.recording import JointSignals, Recording, RecordingError
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, filled_gaps, trajectory
from sim_backend.reality_gap.subjects.joints.rollouts.forward import HELD_KG_M2, LONGEST_IN_LOOP_S, LONGEST_STEP_S
from sim_backend.reality_gap.subjects.subject import Progress

_EDGE_S = 0.1
"""Of a recording, at both ends, where windows neither begin nor end: its smoothed velocity is not as good there."""
_RESAMPLED = 2000
_LEFT_OUT = ("CONTACT", "EQUALITY", "AUTORESET")


@dataclass(frozen=True)
class ReplayErrors:
    """How far models went from where robots went.

    Attributes:
        models: their names, in order.
        recordings: names, in order.
        windows: of each recording, how many.
        joints: names, in order.
        error_rad: mean absolute error of each recording, joint and model, shape (r, k, m); not finite where one diverged.
        window_s: length of windows; 0 for whole recordings.
    """

    models: tuple[str, ...]
    recordings: tuple[str, ...]
    windows: tuple[int, ...]
    joints: tuple[str, ...]
    error_rad: np.ndarray
    window_s: float

    def document(self) -> dict[str, Any]:
        """As JSON: of each model the mean over recordings and joints with a 95 % interval over recordings, then all of them.

        Numbers are None where a simulation diverged.
        """
        weights = np.array(self.windows, dtype=float)
        by_recording = self.error_rad.mean(axis=1)
        drawn = np.random.default_rng(0).integers(0, len(weights), (_RESAMPLED, len(weights)))
        together = np.einsum("rn,rnm->rm", weights[drawn], by_recording[drawn]) / weights[drawn].sum(axis=1)[:, None]
        means = weights @ by_recording / weights.sum()
        with np.errstate(invalid="ignore"):
            edges = np.quantile(together, [0.025, 0.975], axis=0)
        return {
            "metric": "mean absolute error of the position, rad",
            "window_s": self.window_s or None,
            "models": [
                {"model": name, "error_rad": _number(means[m]), "interval_95": [_number(edge[m]) for edge in edges]}
                for m, name in enumerate(self.models)
            ],
            "recordings": [
                {
                    "recording": name,
                    "windows": self.windows[r],
                    "error_rad": {
                        model: dict(zip(self.joints, map(_number, self.error_rad[r, :, m]), strict=True))
                        for m, model in enumerate(self.models)
                    },
                }
                for r, name in enumerate(self.recordings)
            ],
        }

    def lines(self) -> list[str]:
        """A table for people."""
        width = max(map(len, (*self.recordings, "mean of all")))
        head = f"{'mean absolute error, mrad':{width}}  " + "  ".join(f"{name:>12}" for name in self.models)
        rows = [
            f"{name:{width}}  " + "  ".join(f"{1e3 * error:12.4g}" for error in self.error_rad[r].mean(axis=0))
            for r, name in enumerate(self.recordings)
        ]
        said = self.document()["models"]
        mean = f"{'mean of all':{width}}  " + "  ".join(
            "    diverged" if each["error_rad"] is None else f"{1e3 * each['error_rad']:12.4g}" for each in said
        )
        edges = [
            "none" if None in each["interval_95"] else " to ".join(f"{1e3 * edge:.3g}" for edge in each["interval_95"])
            for each in said
        ]
        return [head, *rows, mean, f"{'95 % interval':{width}}  " + "  ".join(f"{edge:>12}" for edge in edges)]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def replay(
    extended: Path,
    source: Path,
    *,
    data_root: Path | None = None,
    others: Sequence[Path] = (),
    window_s: float = 0.0,
    progress: Progress = lambda *_: None,
) -> ReplayErrors:
    """Simulate recordings with the model of their study file, with an extended model, and with others.

    Args:
        extended: folder of a study's results or its ``extended-model.xml``, or another MJCF file.
        source: a study.toml with the recordings.
        data_root: where its data lie; what it says if None.
        others: more MJCF files, such as a published model.
        window_s: from how far back each window begins anew where the robot was; 0 for whole recordings.
        progress: told what is done.

    Raises:
        RecordingError: the model or the data cannot be used; the message says why.
    """
    study_file = load_study_file(source, data_root)
    recordings = [r for r in read_recordings(study_file, lambda what: progress(f"reading {what}", 0.0)) if r.joints is not None]
    if not recordings:
        raise RecordingError(f"{source}: there are no joints to replay")
    names = recordings[0].joints.names if recordings[0].joints is not None else ()
    models = {"nominal": study_file.compile_model(), "extended": _model(extended)}
    models |= {path.stem: _model(path) for path in others}
    laws_file = _folder(extended) / LAWS
    laws = {"extended": laws_file if laws_file.is_file() else None}
    for name, model in models.items():
        missing = [joint for joint in names if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) < 0]
        if missing:
            raise RecordingError(f"the {name} model has no joint {missing[0]!r}, which {source} has")
    errors, windows = [], []
    for at, recording in enumerate(recordings):
        progress(recording.name, at / len(recordings))
        path = trajectory(recording)
        parts = _parts(path, window_s)
        if not parts:
            raise RecordingError(f"{recording.name} has no window of {window_s:g} s in which everything was measured")
        each = [[_error_rad(path, part, model, laws.get(name)) for part in parts] for name, model in models.items()]
        errors.append(np.array(each).mean(axis=1).T)
        windows.append(len(parts))
    return ReplayErrors(tuple(models), tuple(r.name for r in recordings), tuple(windows), names, np.array(errors), window_s)


def _folder(extended: Path) -> Path:
    """Where a study's laws lie: also of its ``extended-model.xml``, which is half of the model without them."""
    return extended.parent if extended.name == NATIVE else extended


def _model(path: Path) -> mujoco.MjModel:
    file = path / NATIVE if path.is_dir() else path
    if not file.is_file():
        raise RecordingError(
            f"there is no {file}: give the folder of a study that found causes in anyone's data, or an MJCF file"
        )
    try:
        return mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        raise RecordingError(f"{file} is no model that MuJoCo can load: {error}") from error


def _parts(path: Trajectory, window_s: float) -> list[slice]:
    """Windows one after the other in which everything was measured, or the whole recording."""
    known: np.ndarray = np.isfinite(np.hstack([path.joints.position_rad, _torques(path.joints)])).min(axis=1)
    edge = round(_EDGE_S / path.step_s) if window_s else 1
    rows = round(window_s / path.step_s) if window_s else len(known) - 2 * edge
    begins = range(edge, len(known) - edge - rows + 1, max(rows, 1))
    return [slice(b, b + rows) for b in begins if rows > 1 and (known[b : b + rows].all() or not window_s)]


def _torques(joints: JointSignals) -> np.ndarray:
    """What drives the joints where no law is known, shape (s, k)."""
    given = joints.measured_torque_nm if joints.commanded_torque_nm is None else joints.commanded_torque_nm
    if given is None:
        raise RecordingError("the recordings have no torques; state what was sent, what was measured, or the controller")
    return given


def _error_rad(path: Trajectory, part: slice, model: mujoco.MjModel, laws: Path | None) -> np.ndarray:
    """Mean absolute error of each joint over a window, shape (k,)."""
    went = simulated(path.recording, part, path.fast_position[part.start], path.fast_velocity[part.start], model, laws)
    off = np.abs(path.joints.position_rad[part][1:] - went[:-1])
    return (
        np.nanmean(np.where(np.isfinite(off), off, np.nan), axis=0) if np.isfinite(went).all() else np.full(off.shape[1], np.inf)
    )


def simulated(
    recording: Recording,
    part: slice,
    begin_rad: np.ndarray,
    begin_rad_s: np.ndarray,
    model: mujoco.MjModel,
    laws: Path | Mapping[str, Mapping[str, float]] | None,
) -> np.ndarray:
    """Positions after each sample of a stretch of a recording, shape (s, k).

    Args:
        recording: with joints.
        part: samples.
        begin_rad: where the joints are at its begin, shape (k,).
        begin_rad_s: how fast they move there, shape (k,).
        model: to be simulated, without contacts, limits and equalities; it is copied.
        laws: as :class:`Laws` takes them; None without.
    """
    joints = recording.joints
    assert joints is not None
    model = mujoco.MjModel.__copy__(model)
    for flag in _LEFT_OUT:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    plays = [j for j in range(model.njnt) if model.joint(j).name.endswith(PLAY_SUFFIX)]
    model.tendon_limited[:], model.jnt_limited[:] = 0, np.isin(np.arange(model.njnt), plays)
    longest_s = LONGEST_STEP_S if joints.feedback is None else LONGEST_IN_LOOP_S
    substeps = int(np.ceil(recording.step_s / longest_s - 1e-9))
    model.opt.timestep = recording.step_s / substeps
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    feedback = None if joints.feedback is None else Feedback.stacked([joints.feedback])
    is_on_board = np.zeros(len(joints.names), bool) if feedback is None else feedback.is_on_board
    on_board = [name for name, is_so in zip(joints.names, is_on_board, strict=True) if is_so]
    acting = Laws(model, {} if laws is None else laws, joints.names, on_board)
    data = mujoco.MjData(model)
    at = [int(model.joint(name).qposadr[0]) for name in joints.names]
    dof = [int(model.joint(name).dofadr[0]) for name in joints.names]
    data.qpos[at], data.qvel[dof] = begin_rad, begin_rad_s
    mujoco.mj_forward(model, data)
    sent = filled_gaps(_torques(joints))[part]
    late_s = np.array([acting.delay_s(name) for name in joints.names])
    if feedback is not None:
        gains, own = (np.array([of(name) for name in joints.names]) for of in (acting.position_gain, acting.own_voltage))
        stiffness, back_emf = gains * feedback.stiffness_nm_rad, own * feedback.back_emf_nm_s_rad
        feedback = replace(feedback, stiffness_nm_rad=stiffness, back_emf_nm_s_rad=back_emf)
    found, before = np.empty((len(sent), len(at))), np.array(begin_rad_s)
    for row in range(len(sent)):
        for step in range(substeps):
            torque = sent[row]
            if feedback is not None:
                now = data.qvel[dof] + 0.5 * (data.qvel[dof] - before)  # velocities are those of half a step ago
                sent_at = part.start + row + step / substeps - late_s[None] / recording.step_s
                law = feedback.of_step(part.start + row, sent_at, 1.0 / substeps)
                before, made = data.qvel[dof].copy(), law.torque_nm(data.qpos[at], now)[0]
                torque = np.where(np.isfinite(made), made, torque)
            acting.apply(model, data, dict(zip(joints.names, map(float, torque), strict=True)))
            if plays and data.time == 0.0:
                _lay_rotors(model, data, plays)
            mujoco.mj_step(model, data)
        found[row] = data.qpos[at]
    return found


def _lay_rotors(model: mujoco.MjModel, data: mujoco.MjData, plays: Sequence[int]) -> None:
    """Put rotors on the side of their play on which they press, by what would hold them and their links together now.

    Args:
        model: of the robots.
        data: in the middle of all plays, with the torques that act.
        plays: joints that are the play of others, by index.
    """
    dofs = model.jnt_dofadr[plays]
    own = model.dof_armature[dofs].copy()
    model.dof_armature[dofs] = HELD_KG_M2
    mujoco.mj_forward(model, data)
    lower, upper = model.jnt_range[plays].T
    data.qpos[model.jnt_qposadr[plays]] = np.where(data.qacc[dofs] > 0.0, upper, lower)
    model.dof_armature[dofs] = own
    mujoco.mj_forward(model, data)
