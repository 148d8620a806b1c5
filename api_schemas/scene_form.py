"""The form of the simulated scene: results of one form are not pooled with, or compared to, those of another."""

FIRST_FORM = "0.1.0"
"""What ran before forms were told: logs, outcomes and robots that name none are of it."""


def form_or_first(told: str | None) -> str:
    """The form that was told, or the first where none was."""
    return told or FIRST_FORM


def told_forms(forms: tuple[str, ...]) -> str:
    """The forms of a job's trials in words; reports from before forms were told have none."""
    if len(forms) < 2:
        return form_or_first(forms[0] if forms else None)
    return f"{' and '.join(forms)}: its trials are of different forms, and their rate is of none"
