"""Forward selection of causes among joints' effects: what gains most is taken, everything is fitted anew, until nothing gains."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, plane_of
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.motor_law import GAP
from sim_backend.reality_gap.subjects.joints.laws.moves import is_plausible, moved, refining_terms, within_reach
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted, JointProblem, Look
from sim_backend.reality_gap.subjects.joints.torques.steady_rows import where_steady

Progress = Callable[[str, float], None]
MAX_CAUSES = 24
MANY_CAUSES = 2.5
"""Noise that all hypotheses together leave, relative to that of the sensors, from which on more than one thing is wrong."""
MAX_REFUSED = 5
_REFINEMENTS, _PLAY_REFINEMENTS = 1, 2
_PROXY_SHARE = {False: 0.04, True: 0.004}
"""A cause that gains less than this share of the largest one may only mend what that one's law leaves."""
_PROXY_SHARE_OF_LEFT = 0.15
"""Where it is known what noise leaves: a cause must gain this share of what the laws leave beside it, for the same reason."""
_STANDS = 0.5
"""Of the value that a cause was chosen with, what must be left of it in the model."""
_PROXY_SHARE_OF_COMMANDS = 0.001
"""Of effects that show in the torques that were sent: there, too, a law may mend another's, but by less."""


@dataclass(frozen=True)
class JointFit:
    """What forward selection came to; ``refused`` gained enough, but without held-out errors that fall.

    ``fallen`` are causes whose values did not stand once less was granted beside them, by name.

    ``problem`` is the one that was given, or the same with many causes expected, of a TriFinger with its steady rows alone.
    """

    problem: JointProblem
    state: JointState
    accepted: tuple[Accepted, ...]
    looks: tuple[Look, ...]
    final: Look
    errors: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    refused: frozenset[tuple[str, str]] = frozenset()
    fallen: frozenset[tuple[str, str]] = frozenset()

    @property
    def first(self) -> Look:
        """Of the nominal model."""
        return self.looks[0]

    @property
    def last(self) -> Look:
        """Of the final causes, with their values as they were chosen; ``final`` has those of the model."""
        return self.looks[-1]


def select(
    problem: JointProblem,
    gate: float,
    progress: Progress,
    *,
    min_share: float = 0.01,
    confirms: Callable[[JointProblem, Look, Look], bool] = lambda *_: True,
    gates: Mapping[str, float] | None = None,
) -> JointFit:
    """Take causes one after the other, and of a TriFinger with few causes only those that stand, with many from steady rows.

    Causes are chosen while masses, torques and friction of the whole robot may be off as in a healthy one, which keeps healthy
    errors from passing for causes. Values are fitted with less of that. A cause whose value then collapses was only good with
    it: it is left out, and the choice is made again; if nothing else is found, it stays as it was.

    Args:
        problem: the episodes, and the model to start from.
        gate: least gain of a cause, nats.
        progress: told what is done, and which share.
        min_share: least share of what is left unexplained that a cause beyond the first must take away.
        gates: least gain of a cause of each effect, where healthy sessions tell.
        confirms: whether a cause is worth it, told the problem and the looks without and with it; if not, the next best is tried.
    """
    whole, first = problem, problem.look(problem.start, ())
    if first.noise_ratio.max() > MANY_CAUSES:
        problem = whole = replace(problem, expects_many=True)
        if whole.is_of_many:
            problem = replace(whole, episodes=where_steady(whole.episodes))
        first = problem.look(problem.start, ())

    def chosen(without: frozenset[tuple[str, str]]) -> JointFit:
        return _chosen(problem, first, without, gate, progress, min_share, confirms, gates or {})

    fit, without = chosen(frozenset()), frozenset[tuple[str, str]]()
    found = fit
    while fallen := _fallen(found):
        without |= fallen
        found = chosen(without)
    found = replace(found, fallen=without) if found.accepted else fit
    return _with_play_of_all_rows(found, whole) if whole.is_of_many else found


def _with_play_of_all_rows(fit: JointFit, whole: JointProblem) -> JointFit:
    """A fit to steady rows with the play of gears fitted to all of them, beside the other values as they are.

    It shows where a torque changes its sign, and steady rows are those where none does.
    """
    play = [a for a in fit.accepted if a.terms[0].key == GAP]
    absent = {(t.key, t.index): float(fit.problem.start.value(t.key)[t.index]) for a in play for t in a.terms}
    state = fit.state.with_values(absent)
    look = whole.look(state, [a for a in fit.accepted if a not in play]) if play else None
    asked = {c.hypothesis.name: c for c in look.candidates} if look else {}
    if look is None or not {(a.effect, a.where) for a in play} <= asked.keys():
        return fit
    for a in play:
        found = asked[(a.effect, a.where)]
        state = moved(state, tuple(look.catalogue.terms[i] for i in found.hypothesis.terms), found.values)
    for _ in range(_PLAY_REFINEMENTS):
        look = whole.look(state, play)
        state = _refined(state, play, look.accepted_values)
    return replace(fit, state=state, errors=fit.errors | _errors(play, look))


def _fallen(fit: JointFit) -> frozenset[tuple[str, str]]:
    """Causes of which less than half is left in the values that the model gets, by name; a group counts as a whole."""
    if not isinstance(fit.problem.robot, KnownTriFinger) or fit.problem.expects_many:
        return frozenset()  # their values are not fitted with less granted beside them
    fallen = set[tuple[str, str]]()
    for a in fit.accepted:
        if plane_of(a.effect) is not None:
            continue  # a size and a place, of which a model has other numbers
        terms = [term for term in a.terms if term.key == a.terms[0].key]
        start, chosen, left = (
            np.array([state.value(term.key)[term.index] for term in terms])
            for state in (fit.problem.start, fit.last.state, fit.state)
        )
        if (chosen - start) @ (left - start) < _STANDS * (chosen - start) @ (chosen - start):
            fallen.add((a.effect, a.where))
    return frozenset(fallen)


def _chosen(
    problem: JointProblem,
    first: Look,
    without: frozenset[tuple[str, str]],
    gate: float,
    progress: Progress,
    min_share: float,
    confirms: Callable[[JointProblem, Look, Look], bool],
    gates: Mapping[str, float],
) -> JointFit:
    """The causes that are taken, some left out, and the model with them; other arguments as of :func:`select`."""
    state = problem.start
    looks, accepted, refused, again = [first], [], set(), set()
    tried = 0
    while len(accepted) < MAX_CAUSES and len(refused) < MAX_REFUSED:
        look = looks[-1]
        least = _later_gain(problem, look, accepted, min_share)
        best = look.best_without(refused | again | without, lambda effect: max(gates.get(effect, gate), least(effect)))  # noqa: B023
        if best is None:
            break
        progress(f"{best.hypothesis.effect}, {best.hypothesis.where}", 0.9 - 0.7 * 0.85**tried)
        tried += 1
        terms = tuple(look.catalogue.terms[i] for i in best.hypothesis.terms)
        before, kept = state, list(accepted)
        state = moved(state, terms, best.values)
        is_new = not {(t.key, t.index) for t in terms} <= {(t.key, t.index) for a in accepted for t in a.terms}
        if is_new:
            accepted = [a for a in accepted if not _contains(best.hypothesis, a)]
            own = refining_terms(look.catalogue, best.hypothesis)
            accepted.append(Accepted(best.hypothesis.effect, best.hypothesis.where, own, best.gain, len(looks) - 1))
        else:  # a number that is in the model already, with all joints: it was far from where its law is straight
            again.add(best.hypothesis.name)
        for _ in range(_REFINEMENTS):
            look = problem.look(state, accepted)
            state = _refined(state, accepted, look.accepted_values)
        new = problem.look(state, accepted)
        is_plausible_now = not problem.is_of_many or is_plausible(state)
        if is_plausible_now and confirms(problem, looks[-1], new):
            looks = [*looks, new] if is_new else [*looks[:-1], new]
            state = _refined(state, accepted, new.accepted_values)
            continue
        state, accepted = before, kept
        refused.add(best.hypothesis.name)
    final = looks[-1]
    if isinstance(problem.robot, KnownTriFinger) and not problem.expects_many:
        final = final.trusting()
        state = _refined(final.state, accepted, final.accepted_values)
    if isinstance(problem.robot, UnknownRobot) and accepted:  # of whose noise nothing is known: least squares
        for _ in range(_REFINEMENTS):
            state = _refined(state, accepted, problem.look(state, accepted, plain=True).accepted_values)
        final = problem.look(state, accepted, plain=True)
    return JointFit(problem, state, tuple(accepted), tuple(looks), final, _errors(accepted, final), frozenset(refused))


def _later_gain(problem: JointProblem, look: Look, accepted: Sequence[Accepted], min_share: float) -> Callable[[str], float]:
    """What a cause of an effect must gain beside others, nats: less may only mend what their laws leave."""
    if not accepted:
        return lambda _: 0.0
    shared = min_share * look.mechanics_left
    if isinstance(problem.robot, UnknownRobot) or problem.expects_many:
        proxy = max(shared, _PROXY_SHARE[problem.expects_many] * max(a.gain for a in accepted))
        return lambda _: proxy
    mechanics = max(shared, _PROXY_SHARE_OF_LEFT * look.beyond_noise)
    sent = max((a.gain for a in accepted if FITTED[a.effect].in_commands), default=0.0)
    commands = max(mechanics, _PROXY_SHARE_OF_COMMANDS * sent)
    return lambda effect: commands if FITTED[effect].in_commands else mechanics


def _contains(hypothesis: Hypothesis, other: Accepted) -> bool:
    """Whether a hypothesis about all joints replaces one about a single joint."""
    return hypothesis.effect == other.effect and hypothesis.where.startswith("all") and not other.where.startswith("all")


def _refined(state: JointState, accepted: Sequence[Accepted], values: np.ndarray) -> JointState:
    at = 0
    for a in accepted:
        state = moved(state, a.terms, within_reach(state, a.terms, values[at : at + len(a.terms)]))
        at += len(a.terms)
    return state


def _errors(accepted: Sequence[Accepted], look: Look) -> dict[tuple[str, str], np.ndarray]:
    at, errors = 0, {}
    for a in accepted:
        errors[(a.effect, a.where)] = look.accepted_errors[at : at + len(a.terms)]
        at += len(a.terms)
    return errors
