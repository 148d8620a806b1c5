"""The accepted causes of a study as files: physics that ``sim_backend`` loads, and plain MJCF."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.model.mjcf import extend_mjcf, robot_mjcf, write_mjcf
from sim_backend.reality_gap.model.model import extended_model, provenance_of, write_extended_model
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind


def write_models(verdict: Verdict, title: str, data: Sequence[Path], out: Path, *, model: Path | None) -> list[Path]:
    """Write the model of a verdict that names causes; nothing where none is named.

    Args:
        verdict: of the study.
        title: of the study, for the file's provenance.
        data: files that were studied.
        out: folder.
        model: the nominal MJCF of foreign data; None for the farm's robots.

    Returns:
        What was written.
    """
    if not verdict.causes or verdict.verdict in (VerdictKind.NOT_IDENTIFIABLE, VerdictKind.CONFUSABLE):
        return []
    written = []
    if model is None:
        provenance = provenance_of(title, verdict.verdict, data)
        found = extended_model(_writable(verdict.causes), provenance, about=verdict.summary)
        write_extended_model(found, out / "extended-model.toml")
        spec, _ = robot_mjcf(found.physics)
        write_mjcf(spec, out / "extended-model.xml", found.estimate)
        return [out / "extended-model.toml", out / "extended-model.xml"]
    spec, missing = extend_mjcf(mujoco.MjSpec.from_file(str(model)), verdict.causes)
    write_mjcf(_finding_its_files(spec, model), out / "extended-model.xml")
    written.append(out / "extended-model.xml")
    if missing:
        (out / "extended-model-missing.txt").write_text("\n".join(missing) + "\n")
        written.append(out / "extended-model-missing.txt")
    return written


def _finding_its_files(spec: mujoco.MjSpec, model: Path) -> mujoco.MjSpec:
    """The same with whole paths to its meshes and textures, which MuJoCo looks for beside the file that names them."""
    if not (spec.meshes or spec.textures or spec.hfields or spec.skins):
        return spec
    found, folder = spec.copy(), model.resolve().parent
    found.meshdir, found.texturedir = str(folder / spec.meshdir), str(folder / spec.texturedir)
    return found


def _writable(causes: Sequence[Cause]) -> list[Cause]:
    """Causes with values inside the catalogue's bounds, as a file must have them."""
    found = []
    for cause in causes:
        parameter = PARAMETERS[f"{cause.effect}.{cause.parameter}"]
        found.append(replace(cause, value=float(np.clip(cause.value, parameter.lower, parameter.upper))))
    return found
