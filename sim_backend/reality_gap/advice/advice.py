"""What to record next: from a study's verdict to excitations, in the order in which they settle most."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.reality_gap.knowledge.excitations import AT_ONCE, BY_HAND, FOLLOWED, SHOWN_BY
from sim_backend.reality_gap.knowledge.separation import SEPARATIONS, Separation
from sim_backend.reality_gap.verdict import AXES, VerdictKind

FIRST = ("standard", "slide_cube")
"""A new robot's: the session that detection limits are stated for, and the only one that moves the cube."""
REPEATS = 2
"""Times that each is recorded: one to fit and one to hold out."""
REPEATS_UNEXPLAINED = 3
"""More, to see whether what is left repeats."""
ONE_BY_ONE = ("chirps", "slow_ramps")
"""Excitations in which joints move one after the other."""


@dataclass(frozen=True)
class Advised:
    """An excitation to run; ``separates`` holds pairs of effects with what tells them apart in it."""

    name: str
    why: str
    shows: tuple[str, ...]
    separates: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class Advice:
    """Excitations in order, how often, and what no excitation gives."""

    why: str
    excitations: tuple[Advised, ...]
    repeats: int
    by_hand: tuple[str, ...]
    said_by_study: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Question:
    """Something to settle: ``text`` for people, excitations that do, and how many of them it takes."""

    text: str
    excitations: tuple[str, ...]
    needs: int
    pair: tuple[str, str, str] | None = None


def first_advice() -> Advice:
    """For a robot of which nothing is known."""
    why = "Nothing is known yet: record a little of everything, then ask again with the study of it."
    reasons = (
        "moves every joint slowly, fast, in chirps and to its ends: the session for which detection limits are stated",
        "moves the cube: friction, mass and the tracker's delays show in nothing else",
    )
    listed = tuple(
        Advised(name, reason, _shown(name), tuple(_pairs_of(name))) for name, reason in zip(FIRST, reasons, strict=True)
    )
    return Advice(why, listed, REPEATS, _hand(AT_ONCE))


def advice_after(verdict: Mapping[str, Any], recorded: Sequence[str] = ()) -> Advice:
    """After a study.

    Args:
        verdict: the ``verdict`` of a study.json.
        recorded: excitations that the study had.

    Raises:
        ValueError: not a verdict; the message says what is missing.
    """
    kind = _kind(verdict)
    said = tuple(str(item) for item in verdict.get("record_next") or ())
    if kind is VerdictKind.NOT_IDENTIFIABLE:
        return _with(first_advice(), "These data could not show anything: record what moves every joint and the cube.", said)
    if kind is VerdictKind.CALIBRATED:
        return _with(first_advice(), "A calibration names no cause: study data without a calibrating method.", said)
    if kind is VerdictKind.NOTHING_WRONG:
        return _after_nothing(recorded, said)
    causes = [(str(cause["effect"]), str(cause["where"])) for cause in verdict.get("causes") or ()]
    effects = list(dict.fromkeys(effect for effect, _ in causes))
    places = {(effect, "" if where in AXES else where) for effect, where in causes}
    rival = (verdict.get("runner_up") or {}).get("effect")
    if kind is VerdictKind.UNEXPLAINED:
        return _after_unexplained(verdict, effects, said)
    if kind is VerdictKind.CONFUSABLE:
        questions = [_between(a, b) for a, b in combinations(effects, 2)]
        if len(effects) < len(places):
            questions.append(_Question("tells at which joint it is: joints that move one by one", ONE_BY_ONE, 1))
        if len(effects) == 1:  # beside something that is no effect, or is at another place
            questions.append(_again(effects[0], recorded))
        whom = f"{effects[0].replace('_', ' ')} from what looks like it" if len(effects) == 1 else f"{_words(*effects)} apart"
        why = f"These data fit more than one explanation: record what tells {whom}."
        return Advice(why, _ordered(questions), REPEATS, _hand(effects), said)
    questions = [] if rival is None or rival in effects else [_between(_likest(effects, str(rival)), str(rival))]
    questions += [_again(effect, recorded) for effect in effects]
    why = f"The cause is named ({_words(*effects)}): hold it to recordings that it was not fitted to."
    return Advice(why, _ordered(questions), REPEATS, _hand(effects), said)


def _kind(verdict: Mapping[str, Any]) -> VerdictKind:
    try:
        kind = VerdictKind(str(verdict.get("verdict")))
    except ValueError:
        valid = ", ".join(VerdictKind)
        raise ValueError(f"its verdict is {verdict.get('verdict')!r}; it must be one of {valid}") from None
    named = [cause.get("effect") if isinstance(cause, Mapping) else cause for cause in verdict.get("causes") or ()]
    unknown = [effect for effect in named if effect not in CATALOGUE]
    if unknown:
        raise ValueError(f"it names {unknown[0]!r}, which is no effect of the catalogue; 'trifarm effects' lists them")
    return kind


def _with(advice: Advice, why: str, said: tuple[str, ...]) -> Advice:
    return Advice(why, advice.excitations, advice.repeats, advice.by_hand, said)


def _after_nothing(recorded: Sequence[str], said: tuple[str, ...]) -> Advice:
    """Whatever was not recorded yet; everything where nothing is known of that."""
    left = [name for name in EXCITATIONS if name not in recorded and name != "standard"]
    why = "Nothing is wrong as far as these data can tell; what they did not contain can still show something."
    questions = [_Question(_missing(name), (name,), 1) for name in left]
    return Advice(why, _ordered(questions), REPEATS, (), said)


def _after_unexplained(verdict: Mapping[str, Any], effects: Sequence[str], said: tuple[str, ...]) -> Advice:
    """Whatever the error follows, unless the data are not as they are told."""
    if verdict.get("misreads"):
        why = "The model does not agree with the data as they are told: check that before more is recorded."
        return Advice(why, (), REPEATS, (), said)
    questions = [_followed(str(text)) for text in verdict.get("follows") or ()]
    why = "No effect of the catalogue explains what is left: record the contrast that it follows, several times."
    questions = questions or [_Question("what is left of the error", FIRST, 1)]
    return Advice(why, _ordered(questions), REPEATS_UNEXPLAINED, _hand(effects), said)


def _missing(name: str) -> str:
    best = [effect for effect, shown in SHOWN_BY.items() if shown[0] == name]
    return f"shows best of all: {_words(*best)}" if best else f"shows {_words(*_shown(name))}"


def _between(first: str, second: str) -> _Question:
    known = SEPARATIONS.get(frozenset((first, second)))
    if known is None:
        both = tuple(dict.fromkeys((*SHOWN_BY.get(first, ())[:1], *SHOWN_BY.get(second, ())[:1])))
        by = "the motion that shows the one best, and the motion that shows the other best"
        known = Separation(by, both, len(both))
    text = f"tells {_words(first)} from {_words(second)}: {known.by}"
    return _Question(text, known.excitations, known.needs, (first, second, known.by))


def _likest(effects: Sequence[str], rival: str) -> str:
    """The effect that a rival is most likely to be taken for."""
    return next((effect for effect in effects if frozenset((effect, rival)) in SEPARATIONS), effects[0])


def _again(effect: str, recorded: Sequence[str]) -> _Question:
    shown = SHOWN_BY.get(effect, ())
    fresh = tuple(name for name in shown if name not in recorded)
    return _Question(f"shows {_words(effect)} well: a new recording of it tests the extended model", fresh or shown, 1)


def _followed(text: str) -> _Question:
    """What a residual follows, such as "time since reversal of finger0_joint_upper"."""
    for variable, (contrast, excitations) in FOLLOWED.items():
        if text.startswith(variable):
            return _Question(f"what is left follows {variable}: {contrast}", excitations, len(excitations))
    return _Question(f"what is left shows in {text}: the cube at rest and in motion", ("slide_cube",), 1)


def _ordered(questions: Sequence[_Question]) -> tuple[Advised, ...]:
    """The excitation that settles most comes first, then the one that settles most of the rest, and so on."""
    open_, chosen = {question: question.needs for question in questions if question.excitations}, list[Advised]()
    while open_:
        left = [name for name in EXCITATIONS if name not in {advised.name for advised in chosen}]
        values = {name: sum(_worth(q, name) for q in open_) for name in left}
        best = max(values, key=lambda name: (values[name], -EXCITATIONS[name].duration_s))
        if values[best] == 0.0:
            break
        chosen.append(_advised(best, tuple(open_)))
        open_ = {q: rest for q, needs in open_.items() if (rest := needs - (best in q.excitations)) > 0}
    return tuple(chosen)


def _worth(question: _Question, name: str) -> float:
    return 1.0 / (1 + question.excitations.index(name)) if name in question.excitations else 0.0


def _advised(name: str, questions: Sequence[_Question]) -> Advised:
    settled = [question for question in questions if name in question.excitations]
    why = "; ".join(dict.fromkeys(question.text for question in settled))
    pairs = tuple(dict.fromkeys(question.pair for question in settled if question.pair is not None))
    return Advised(name, why, _shown(name), pairs)


def _shown(name: str) -> tuple[str, ...]:
    """Effects that an excitation shows; the standard session shows what any motion without the cube does."""
    if name == "standard":
        return tuple(effect for effect, shown in SHOWN_BY.items() if set(shown) - {"slide_cube"})
    return tuple(effect for effect, shown in SHOWN_BY.items() if name in shown)


def _pairs_of(name: str) -> list[tuple[str, str, str]]:
    found = []
    for pair, separation in SEPARATIONS.items():
        has = set(separation.excitations) - {"slide_cube"} if name == "standard" else name in separation.excitations
        if has:
            first, second = sorted(pair)
            found.append((first, second, separation.by))
    return found


def _hand(effects: Sequence[str]) -> tuple[str, ...]:
    return tuple(BY_HAND[effect] for effect in effects if effect in BY_HAND)


def _words(*effects: str) -> str:
    return ", ".join(effect.replace("_", " ") for effect in effects)
