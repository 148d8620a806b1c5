"""Why a trial failed: ``python -m robot_farm.explaining LOG --truth FILE --graph FILE [--confined CPU_S]``.

Simulates the trial again with its policy in the loop, compares every number with log and truth, and then takes effects away
(``sim_backend/replays/counterfactual.py``). The policy runs in its own jail, as on a robot; ``--confined`` jails this process,
too, once the policy's runs. Prints one JSON document, and what it is at on standard error. Exit codes: 0 answered, 2 the files
cannot be used or there is nothing to explain, 6 the first replay gives other numbers, 10 they do and the log is of another form
of the scene.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.builtin_mark import BUILTIN_MARK
from api_schemas.policy import PolicyManifest
from api_schemas.why import Why, WhyEffect, WhyGroup, WhyVerdict
from jail.entering import enter
from jail.level import JailLevel
from jail.needs import Needs
from robot_farm.policy.jail import BUILTIN_PROCESS, POLICY_PROCESS, JailedPolicy, PolicyFailedError, most_trials
from sim_backend import warm_up
from sim_backend.effects.causes import CAUSES
from sim_backend.replays.comparison import NotRepeatableError, Verification
from sim_backend.replays.counterfactual import Again, Explanation, Tried, explain
from sim_backend.replays.with_truth import verify_with_truth
from sim_backend.trifinger.form import scene_form
from trial_logs.reader import LogUnreadableError, TrialLog, TruthLog, read_log, read_truth

EXIT_UNFIT = 2
EXIT_DIFFERS = 6
EXIT_OTHER_FORM = 10
MEMORY_LIMIT_BYTES = 3 * 1024**3
NICENESS = 10
LONGEST_REASON = 300
_WORDS = {cause.name: cause.words for cause in CAUSES}


class NothingToExplainError(Exception):
    """The trial did not miss its goal on a robot with physics of its own; the message says what it is."""


class OtherNumbersError(Exception):
    """The first replay is not bit for bit what the log says."""

    def __init__(self, message: str, *, other_form: bool) -> None:
        super().__init__(message)
        self.other_form = other_form


class PolicyInLoop:
    """A jailed policy as counterfactual replays ask it."""

    def __init__(self, policy: JailedPolicy) -> None:
        self._policy = policy

    def most(self, observation_size: int) -> int:
        """So many trials may be under way together."""
        return most_trials(observation_size)

    def begin(self, trials: int = 1) -> None:
        """Forget all trials before; so many begin."""
        self._policy.reset(trials)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The actions (trials, 9) of observations (trials, size), float32."""
        return self._policy.act_each(observation)

    def act_alone(self, observation: np.ndarray) -> np.ndarray:
        """The action (9,) of the observation (size,) of the only trial, float32."""
        return self._policy.act(observation)[0]


def why(log: TrialLog, truth: TruthLog, policy: PolicyInLoop, *, effects: bool = True) -> Why:
    """The answer about one trial; says on standard error what it is at.

    Raises:
        NothingToExplainError: the trial did not fail.
        OtherNumbersError: the first replay gives other numbers.
        LogUnreadableError: log and truth are not of one trial.
        NotRepeatableError: the trial cannot be simulated again.
    """
    _check(log)
    _say("the trial as it was", 0)
    policy.begin()
    found = verify_with_truth(log, truth, act=policy.act_alone)
    if not found.same:
        raise OtherNumbersError(_differs(found), other_form=found.form != found.simulated_form)
    return answer(
        log.metadata["trial_id"], Again.of(log, truth), explain(Again.of(log, truth), policy, effects=effects, told=_say)
    )


def answer(trial_id: str, trial: Again, found: Explanation) -> Why:
    """The answer as it is sent."""
    physics = [trial.physics, *(physics for _, physics in trial.changes)]
    values: dict[str, Any] = {}
    for each in physics:
        values |= each.document()
    return Why(
        trial=trial_id,
        verdict=WhyVerdict(found.verdict),
        control_successes=found.control_successes,
        control_replays=found.control_replays,
        groups=tuple(WhyGroup(words=_WORDS[each.name], **_counts(each)) for each in found.groups),
        effects=tuple(WhyEffect(values=values.get(each.name, {}), **_counts(each)) for each in found.effects),
        replays=found.replays + 1,
    )


def _counts(tried: Tried) -> dict[str, Any]:
    counted = {name: getattr(tried, name) for name in ("name", "turned", "successes", "replays")}
    return counted | {"explains": tried.explains}


def _check(log: TrialLog) -> None:
    trial = log.metadata.get("trial_id", "the trial")
    if log.manifest is None:
        raise NothingToExplainError(f"{trial} is an excitation; it has no goal to miss")
    if PolicyManifest.model_validate_json(log.manifest).images is not None:
        raise NothingToExplainError("its policy sees images, and replays of other robots have none to show it")
    kind = log.outcome.get("kind")
    if kind != "failed":
        raise NothingToExplainError(f"{trial} {kind}; only a trial that ran to its end and missed its goal is explained")
    if len(log.cube_steps):
        raise NothingToExplainError(f"{trial} ran on an ideal robot: there is no effect to take away, so that it was the policy")
    if log.metadata.get("form") != scene_form():
        form = log.metadata.get("form") or "an older one"
        raise OtherNumbersError(
            f"the log is of scene form {form}, this installation simulates {scene_form()}; use the version that ran the trial",
            other_form=True,
        )


def _differs(found: Verification) -> str:
    return f"the first replay differs from the log from step {found.first_difference_step} on and tells nothing"


def _say(what: str, done: int) -> None:
    print(f"after {done} replays: {what}", file=sys.stderr, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="trifarm why", description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--graph", type=Path, required=True)
    parser.add_argument("--confined", type=int, metavar="CPU_S")
    parser.add_argument("--jail-level", type=JailLevel, default=JailLevel.NONE)
    parser.add_argument("--groups-only", action="store_true")
    asked = parser.parse_args(arguments)
    module = BUILTIN_PROCESS if _mark(asked.graph).startswith(BUILTIN_MARK) else POLICY_PROCESS
    policy = JailedPolicy("asked again", asked.graph, least=asked.jail_level, module=module)
    if asked.confined is not None:
        policy.reset()
        _confine(asked.confined)
        return _answered(asked, policy)  # the policy's process ends with this one, which may not end it any more
    with policy:
        return _answered(asked, policy)


def _mark(graph: Path) -> bytes:
    with graph.open("rb") as file:
        return file.read(len(BUILTIN_MARK))


def _confine(cpu_s: int) -> None:
    """Jail this process before it reads what it was given."""
    os.nice(NICENESS)
    warm_up.main()
    enter(Needs(MEMORY_LIMIT_BYTES, cpu_s, 1024**2, installation=True, folder=Path.cwd()))


def _answered(asked: argparse.Namespace, policy: JailedPolicy) -> int:
    try:
        found = why(read_log(asked.log), read_truth(asked.truth), PolicyInLoop(policy), effects=not asked.groups_only)
    except OtherNumbersError as error:
        return _refused(str(error), EXIT_OTHER_FORM if error.other_form else EXIT_DIFFERS)
    except (LogUnreadableError, NothingToExplainError, NotRepeatableError, PolicyFailedError) as error:
        return _refused(str(error), EXIT_UNFIT)
    print(found.model_dump_json())
    return 0


def _refused(reason: str, code: int) -> int:
    print(json.dumps({"error": reason[:LONGEST_REASON]}))
    return code


if __name__ == "__main__":
    sys.exit(main())
