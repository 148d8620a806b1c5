"""What is known of the effects that a tossed object shows: what each would change, and what measures it by hand."""

from dataclasses import dataclass

OBJECT = "object"
"""Stands for the name of the object's body."""


@dataclass(frozen=True)
class TossEffect:
    """An effect that tosses can name.

    Attributes:
        keys: of its numbers, "effect.parameter".
        where: it would act; ``OBJECT`` for the object itself.
        measured_by: what a person measures to settle it.
        of_contact: whether it changes the object or its contacts, so that its first number may leave the motion as it is.
    """

    keys: tuple[str, ...]
    where: str
    measured_by: str = "slower and faster contacts, on the flat and on edges"
    of_contact: bool = False

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.keys[0].partition(".")[0]


TOSSED = (
    TossEffect(("table_friction.coefficient",), "table", of_contact=True),
    TossEffect(("contact_stiffness.time_constant_s", "contact_stiffness.damping_ratio"), OBJECT, of_contact=True),
    TossEffect(("cube_mass.factor",), OBJECT, of_contact=True),
    TossEffect(("cube_size.factor",), OBJECT, "the object with a caliper", of_contact=True),
    TossEffect(("gravity.offset_m_s2",), "world", "a longer free fall"),
    TossEffect(("table_tilt.roll_rad", "table_tilt.pitch_rad"), "table", "the table with a level"),
    TossEffect(("tracking_scale.factor_error",), "camera", "a known distance"),
    TossEffect(("tracking_offset.position_m",), "camera", "heights at two levels"),
)
"""In the order in which they are asked."""
