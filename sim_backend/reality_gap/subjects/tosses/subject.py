"""A tossed object as a subject: its flights, bounces and rests replayed, and the verdict on what explains them."""

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import Robot
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.subject import Material, Progress, Sections
from sim_backend.reality_gap.subjects.tosses.study import ObjectStudy, makes_worse, study_object
from sim_backend.reality_gap.verdict import Verdict, VerdictKind


def seen_in(material: Material) -> tuple[Recording, ...]:
    """Recordings of anybody's objects without joints."""
    return tuple(r for r in material.recordings if r.joints is None and r.objects) if material.study_file is not None else ()


def study(material: Material, known: Robot, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, Sections]:
    """As of any :class:`Subject`; no robot takes part."""
    del known
    assert material.study_file is not None
    nominal = {key: float(value) for key, value in material.study_file.nominal.items() if isinstance(value, int | float)}
    model = mujoco.MjSpec.from_file(str(material.study_file.model))
    found = study_object(model, seen_in(material), nominal, rng, progress)
    return _verdict(found), dict(found.sections)


def _verdict(found: ObjectStudy) -> Verdict:
    return Verdict(
        verdict=found.kind,
        summary=_summary(found),
        causes=found.causes,
        held_out=found.confirmation.held_out if found.confirmation is not None else None,
        null_p=found.null_p,
        runner_up=found.runner_up,
        rejected=tuple(one.rival for one in found.lost if not one.confusable),
        cannot_tell=found.cannot_tell,
        record_next=found.record_next,
    )


def _summary(found: ObjectStudy) -> str:
    if found.kind is VerdictKind.UNEXPLAINED and found.confirmation is not None and makes_worse(found.confirmation.held_out):
        return "What explains the tosses that were studied puts others further off: no cause of the catalogue does."
    named = ", ".join(dict.fromkeys(cause.effect.replace("_", " ") for cause in found.causes))
    return {
        VerdictKind.NAMED: f"The data disagree with the model because of {named}.",
        VerdictKind.CONFUSABLE: f"The data cannot tell apart: {named}.",
        VerdictKind.UNEXPLAINED: "The data disagree with the model far beyond the noise; no cause of the catalogue explains it.",
    }.get(found.kind, "The data agree with the model as well as they can tell.")
