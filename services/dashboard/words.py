"""Numbers and times as people read them; the filters of the templates."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from markupsafe import Markup

STATES = {
    "idle": "idle",
    "leased": "starting",
    "running": "running",
    "draining": "draining",
    "out_of_service": "out of service",
    "lost": "lost",
    "queued": "queued",
    "held": "held back",
    "succeeded": "succeeded",
    "failed": "failed",
    "cancelled": "cancelled",
    "done": "done",
    "failed_by_platform": "failed by the platform",
}


def percent(fraction: float | None) -> str:
    """A fraction as whole percent."""
    return "–" if fraction is None else f"{100 * fraction:.0f} %"


def points(difference: float) -> str:
    """A difference of two rates, in percentage points."""
    return f"{100 * difference:+.1f}".replace("-", "−")


def chance(p: float) -> str:
    """A p-value."""
    return f"{p:.4f}" if p >= 1e-4 else "< 0.0001"


def duration(seconds: float | None) -> str:
    """A duration in one or two units."""
    if seconds is None:
        return "–"
    whole = int(max(seconds, 0))
    for unit_s, unit, next_s, following in ((86_400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit_s:
            rest = whole % unit_s // next_s
            return f"{whole // unit_s} {unit} {rest} {following}" if rest else f"{whole // unit_s} {unit}"
    return f"{whole} s"


def ago(at: str | None) -> str:
    """How long ago a moment was, no finer than a reader cares for: a list that is watched must not change each second."""
    if at is None:
        return "–"
    seconds = (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds()
    for unit_s, unit in ((86_400, "d"), (3600, "h"), (60, "min")):
        if seconds >= 2 * unit_s or (unit_s == 60 and seconds >= unit_s):
            return f"{seconds // unit_s:.0f} {unit} ago"
    return "just now"


def moment(at: str | None) -> str:
    """A moment to the second; the reader's browser writes it in their own time zone."""
    if at is None:
        return "–"
    return Markup('<time datetime="{}">{} UTC</time>').format(at, at[:19].replace("T", " "))


def millimetres(metres: float | None) -> str:
    """A length of a few centimetres."""
    return "–" if metres is None else f"{1e3 * metres:.1f}"


def degrees(radians: float | None) -> str:
    """An angle."""
    return "–" if radians is None else f"{radians * 57.29577951308232:.1f}"


def state(name: Any) -> str:
    """The word for a state."""
    return STATES.get(str(name), str(name).replace("_", " "))


def step(number: float) -> str:
    """A number of a ladder as it was given, without a fraction where it has none."""
    return f"{number:,.0f}" if number == int(number) else f"{number:,.6g}"


def counted(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


FILTERS: dict[str, Callable[..., str]] = {
    "percent": percent,
    "points": points,
    "chance": chance,
    "duration": duration,
    "ago": ago,
    "moment": moment,
    "millimetres": millimetres,
    "degrees": degrees,
    "state": state,
    "step": step,
    "counted": counted,
}
