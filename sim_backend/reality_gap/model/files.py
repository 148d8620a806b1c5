"""The accepted causes of a study as files: physics that ``sim_backend`` loads, and plain MJCF."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import LATE_TORQUE as _DELAY
from sim_backend.reality_gap.model import extended_laws
from sim_backend.reality_gap.model.mjcf import extend_mjcf, robot_mjcf, write_mjcf
from sim_backend.reality_gap.model.model import extended_model, provenance_of, write_extended_model
from sim_backend.reality_gap.model.native_elements import actuators_of
from sim_backend.reality_gap.model.native_laws import joints_of
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

NATIVE, LAWS = "extended-model.xml", "extended-laws.json"
"""The extended model of anyone's robot: what MJCF can say, and what :mod:`.extended_laws` does beside it."""


def write_models(
    verdict: Verdict,
    title: str,
    data: Sequence[Path],
    out: Path,
    *,
    model: Path | None,
    stated: Sequence[Cause] = (),
    on_board: Sequence[str] = (),
) -> list[Path]:
    """Write the model of a verdict that has causes; nothing where it has none.

    Args:
        verdict: of the study.
        title: of the study, for the file's provenance.
        data: files that were studied.
        out: folder.
        model: the nominal MJCF of foreign data; None for the farm's robots.
        stated: values that foreign data's study file starts from; causes replace them.
        on_board: joints whose targets are what a delay makes late, not their torques.

    Returns:
        What was written.
    """
    if not verdict.causes or verdict.verdict in (VerdictKind.NOT_IDENTIFIABLE, VerdictKind.CONFUSABLE):
        return []
    written = []
    if model is None:
        provenance = provenance_of(title, verdict.verdict, data)
        found = extended_model(writable(verdict.extended or verdict.causes), provenance, about=verdict.summary)
        write_extended_model(found, out / "extended-model.toml")
        spec, _ = robot_mjcf(found.physics)
        write_mjcf(spec, out / "extended-model.xml", found.estimate)
        return [out / "extended-model.toml", out / "extended-model.xml"]
    causes = (*stated, *(verdict.extended or verdict.causes))
    nominal = mujoco.MjSpec.from_file(str(model))
    untold = [cause for cause in causes if _is_of_targets(cause, nominal, on_board)]
    spec, missing = extend_mjcf(nominal, [cause for cause in causes if cause not in untold])
    missing += [f"{cause.effect} at {cause.where}: its targets are late, and no actuator there takes targets" for cause in untold]
    write_mjcf(_finding_its_files(spec, model), out / NATIVE)
    written.append(out / NATIVE)
    if laws := _laws(causes, spec):
        late = [name for name, values in laws.items() if name in on_board and _DELAY in values]
        (out / LAWS).write_text(json.dumps({"joints": laws} | ({"on_board": late} if late else {}), indent=1) + "\n")
        (out / Path(extended_laws.__file__).name).write_bytes(Path(extended_laws.__file__).read_bytes())
        written += [out / LAWS, out / Path(extended_laws.__file__).name]
    if missing:
        (out / "extended-model-missing.txt").write_text("\n".join(missing) + "\n")
        written.append(out / "extended-model-missing.txt")
    return written


def _is_of_targets(cause: Cause, spec: mujoco.MjSpec, on_board: Sequence[str]) -> bool:
    """Whether a cause is a delay of targets at joints without an actuator that takes targets."""
    places = joints_of(spec) if cause.where == "all joints" else [cause.where]
    if f"{cause.effect}.{cause.parameter}" != _DELAY or not set(places) <= set(on_board):
        return False
    driving = [actuator for place in places for actuator in actuators_of(spec, place)]
    return all(actuator.biastype == mujoco.mjtBias.mjBIAS_NONE for actuator in driving)


def _laws(causes: Sequence[Cause], spec: mujoco.MjSpec) -> dict[str, dict[str, float]]:
    """By joint, what :mod:`.extended_laws` is to do, shape parameters with it; nothing of joints without such a law."""
    found: dict[str, dict[str, float]] = {}
    for cause in (cause for cause in causes if cause.effect in extended_laws.EFFECTS):
        effect = CATALOGUE[cause.effect]
        for name in joints_of(spec) if cause.where == "all joints" else [cause.where]:
            own = found.setdefault(name, {})
            for parameter in effect.all_parameters:
                own.setdefault(effect.key(parameter), parameter.absent)
            own[f"{cause.effect}.{cause.parameter}"] = cause.value
    return found


def _finding_its_files(spec: mujoco.MjSpec, model: Path) -> mujoco.MjSpec:
    """The same with whole paths to its meshes and textures, which MuJoCo looks for beside the file that names them."""
    if not (spec.meshes or spec.textures or spec.hfields or spec.skins):
        return spec
    found, folder = spec.copy(), model.resolve().parent
    found.meshdir, found.texturedir = str(folder / spec.meshdir), str(folder / spec.texturedir)
    return found


def writable(causes: Sequence[Cause]) -> list[Cause]:
    """Causes with values inside the catalogue's bounds, as a file must have them."""
    found = []
    for cause in causes:
        parameter = PARAMETERS[f"{cause.effect}.{cause.parameter}"]
        found.append(replace(cause, value=float(np.clip(cause.value, parameter.lower, parameter.upper))))
    return found
