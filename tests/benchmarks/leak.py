"""Do answers about failed trials tell a robot's hidden physics? Who has logs and answers against who has the logs alone.

    python -m tests.benchmarks.leak --lines FILE.jsonl [--robots 30] [--answers 500] [--for-s 240] [--first-seed 82000]
    python -m tests.benchmarks.leak --lines FILE.jsonl --summary results/leak.json

Robots are drawn from `real`; each tries goals with two policies, the one that fails often until there are enough failures, and
these are asked about, one of every robot in turn and no more of one than a user may. An answer is what ``trifarm why`` tells a
user: the verdict and the names of groups, no counts. The attacker knows the truth of all robots but one, learns from it, and
predicts that one's effects. Of the logs they have some hundred numbers that say much about effects: noise, speeds, torques,
friction at rest, lateness, gaps and spread of the tracker's reports, and how often it failed; of the answers the shares of all
verdicts and groups. The prediction from logs is ridge regression, averaged over penalties by how likely they make the robots that
are known; the answers move it by the one of their numbers that goes best with what the logs leave of a parameter, where so much
is no luck. What is compared is the error of each effect as a share of its variance, in the mean over the effects.

Whether such an attacker would notice a leak is tried with answers that have one: each robot's shares of groups are moved by its
true values.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy import stats

from api_schemas import policy_graph
from api_schemas.policy import PolicyManifest
from api_schemas.success_rate import wilson
from api_schemas.why import WhyVerdict
from robot_farm.explaining import answer
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.effects.causes import CAUSES
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Per, load_ranges
from sim_backend.episode import Episode
from sim_backend.replays.counterfactual import Again, explain, goals, starts
from sim_backend.tasks.scoring import score
from tests.benchmarks.graphs import graph_of
from tests.benchmarks.planted_causes import begun

TRIALS = {"push-adr": 16, "push-scratch": 24}
"""Of each robot with each policy in a stretch; all trials of a stretch are simulated together."""
STRETCHES = {"push-adr": 1, "push-scratch": 3}
"""At the most; there is another one as long as fewer than ``ENOUGH`` trials of the robot have failed."""
ENOUGH, QUESTIONS = 18, 20
"""A user may ask so many questions about one robot (``services/settings.py``)."""
PENALTIES = np.logspace(-1, 3, 7)
LUCK = 0.05
"""Chance with which some number of the answers goes so well with what is left of a parameter by luck."""
BOOTSTRAPS, SHUFFLES = 10_000, 50
PLANTED_SHARE = 1.0
"""Standard deviations of an answer's share that one of the truth moves it by, where a leak is made."""
STILL_RAD_S = 0.02
_KINDS = ("none", "one group", "two groups", "three groups or more")
"""By how many groups a user is told; no more than three are."""


class NetworkInLoop:
    """A shipped policy as replays ask it, in this process; each trial has its own memory of it."""

    def __init__(self, graph: Path) -> None:
        self._first = policy_graph.GraphRunner(policy_graph.session(graph))
        self._runners = [self._first]

    def most(self, observation_size: int) -> int:
        """So many trials may be under way together."""
        return 16

    def begin(self, trials: int) -> None:
        """Forget all trials before; so many begin."""
        self._runners = [self._first.another() for _ in range(trials)]

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The actions (trials, 9) of observations (trials, size), float32."""
        rows = zip(self._runners, observation, strict=True)
        return np.array([runner.act(row[None]).reshape(-1) for runner, row in rows]).astype(float)


@dataclass
class Logged:
    """What logs of trials that ran together hold, as far as the attacker looks at it; joints at 1 kHz in stretches."""

    noise: list[np.ndarray] = field(default_factory=list)
    states: list[tuple[np.ndarray, ...]] = field(default_factory=list)
    reports: list[TrackedPose] = field(default_factory=list)


def run_together(trials: list[Again], policy: NetworkInLoop) -> tuple[Logged, np.ndarray, np.ndarray]:
    """The logs of trials, how far from its goal each ended, m, and which of them succeeded."""
    one, physics, goal = trials[0], Physics.stack([trial.physics for trial in trials]), goals(trials)
    driver, tracker = SimulatedDriver(robots=len(trials), physics=physics), Tracker(physics=physics)
    episode, logged = Episode(driver, tracker, one.manifest), Logged()
    policy.begin(len(trials))
    logged.reports.append(episode.begin(starts(trials), goal))
    for _ in range(one.task.steps // one.manifest.period_steps):
        period = episode.advance(policy.act(episode.observe().astype(np.float32)))
        segment = period.segment
        q, qd = segment.joint_position_rad, segment.joint_velocity_rad_s
        logged.noise.append(np.stack([np.diff(q, 2, axis=1).var(axis=1), np.diff(qd, 2, axis=1).var(axis=1)]))
        ends = (q[:, -1], qd[:, -1], segment.measured_torque_nm.mean(axis=1), segment.applied_torque_nm.mean(axis=1))
        logged.states.append((*ends, (q[:, -1] - q[:, 0]) / (1e-3 * (q.shape[1] - 1))))
        logged.reports += period.tracked
    state = episode.measurement
    scores = score(one.task, goal, state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
    return logged, scores.position_error_m, scores.success


def features(logged: Logged, trials: list[Again], error_m: np.ndarray, success: np.ndarray) -> dict[str, float]:
    """What the attacker reads from the logs of a robot with one policy: means over its trials."""
    q, qd, measured, applied, moved = (np.stack(each, axis=1) for each in zip(*logged.states, strict=True))
    noise = np.mean(logged.noise, axis=0)  # (2, trials, joints)
    acceleration = np.diff(qd, axis=1)
    still = np.abs(qd) < STILL_RAD_S
    by_joint = {
        "position noise": np.sqrt(noise[0]).mean(axis=0),
        "velocity noise": np.sqrt(noise[1]).mean(axis=0),
        "speed": np.abs(qd).mean(axis=(0, 1)),
        "torque": np.abs(measured).mean(axis=(0, 1)),
        "mean torque": measured.mean(axis=(0, 1)),
        "torque at rest": (np.abs(measured) * still).sum(axis=(0, 1)) / np.maximum(still.sum(axis=(0, 1)), 1),
        "torque reported of applied": (measured * applied).sum(axis=(0, 1)) / (applied**2).sum(axis=(0, 1)).clip(1e-9),
        "velocity reported of moved": (qd * moved).sum(axis=(0, 1)) / (moved**2).sum(axis=(0, 1)).clip(1e-9),
        "acceleration of torque": (acceleration * applied[:, 1:]).sum(axis=(0, 1)) / (applied**2).sum(axis=(0, 1)).clip(1e-9),
        "late acceleration of torque": (acceleration[:, 1:] * applied[:, 1:-1]).sum(axis=(0, 1))
        / (applied**2).sum(axis=(0, 1)).clip(1e-9),
        "where it stops": q[:, -50:].mean(axis=(0, 1)),
    }
    found = {f"{name}, joint {joint}": float(each[joint]) for name, each in by_joint.items() for joint in range(9)}
    return found | _of_tracker(logged.reports, trials, error_m, success)


def _of_tracker(reports: list[TrackedPose], trials: list[Again], error_m: np.ndarray, success: np.ndarray) -> dict[str, float]:
    capture, delivery = (np.stack([getattr(each, name) for each in reports]) for name in ("capture_step", "delivery_step"))
    position, quat = (
        np.stack([each.cube_position_world_m for each in reports]),
        np.stack([each.cube_quat_wxyz for each in reports]),
    )
    confidence = np.stack([each.confidence for each in reports])
    rows: list[dict[str, float]] = []
    for row, trial in enumerate(trials):
        new = np.flatnonzero(np.diff(capture[:, row], prepend=-(10**9)) > 0)
        at, late_s = capture[new, row] * 1e-3, (delivery[new, row] - capture[new, row]) * 1e-3
        place, turned = position[new, row], np.abs((quat[new[1:], row] * quat[new[:-1], row]).sum(axis=1)).clip(0, 1)
        seen_m = np.median(np.linalg.norm(place[-5:] - trial.goal.cube_position_world_m[0], axis=1))
        rows.append(
            {
                "period": float(np.median(np.diff(at))),
                "lost": float((np.diff(at) > 1.5 * np.median(np.diff(at))).mean()),
                "late": float(np.median(late_s)),
                "late spread": float(late_s.std()),
                "confidence": float(confidence[new, row].mean()),
                "unsure": float((confidence[new, row] < 0.75).mean()),
                "shake": float(np.median(np.linalg.norm(np.diff(place, 2, axis=0), axis=1))),
                "shake when turning": float(np.median(2 * np.arccos(turned))),
                "jumps": float((2 * np.arccos(turned) > 0.5).mean()),
                "height": float(np.median(place[:5, 2])),
                "seen and judged": float(seen_m - error_m[row]),
                "error": float(error_m[row]),
                "success": float(success[row]),
            }
        )
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def trials_of(first_seed: int, robot: int, manifests: dict[str, PolicyManifest], stretches: int) -> tuple[Physics, dict]:
    """A robot, and its trials with each policy, in so many stretches at the most."""
    rng, ranges = np.random.default_rng([first_seed, robot]), load_ranges("real")
    physics = ranges.draw(rng, 1)
    made = {
        name: [
            begun(ranges.draw_episode(rng, physics), int(rng.integers(2**31)), int(rng.integers(2**53)), manifests[name])
            for _ in range(trials * min(stretches, STRETCHES[name]))
        ]
        for name, trials in TRIALS.items()
    }
    return physics, made


def truth_of(physics: Physics) -> dict[str, float]:
    """What the attacker wants to know: each parameter that differs from robot to robot, in the mean over joints or axes."""
    keys = [row.key for row in load_ranges("real").rows if row.per is Per.ROBOT]
    return {key: float(physics.value(key).mean()) for key in keys}


def logs_of(first_seed: int, robot: int, stretch: int, graphs: dict[str, tuple[Path, PolicyManifest]]) -> dict:
    """The line of a stretch of one robot's logs."""
    manifests = {name: manifest for name, (_, manifest) in graphs.items()}
    physics, made = trials_of(first_seed, robot, manifests, stretch + 1)
    line: dict = {"robot": robot, "stretch": stretch, "truth": truth_of(physics), "logs": {}, "failed": []}
    for name, size in TRIALS.items():
        if stretch < STRETCHES[name]:
            trials, policy = made[name][stretch * size :], NetworkInLoop(graphs[name][0])
            logged, error_m, success = run_together(trials, policy)
            line["logs"] |= {f"{name}: {key}": value for key, value in features(logged, trials, error_m, success).items()}
            line["failed"] += [[name, stretch * size + at] for at in np.flatnonzero(~success).tolist()]
    line["failed"].sort(key=lambda each: each[1] / TRIALS[each[0]])
    return line


def failed_of(lines: list[dict]) -> dict[int, list]:
    """Of each robot the trials that may be asked about, policy and number."""
    stretches = sorted((line for line in lines if "logs" in line), key=lambda line: line["stretch"])
    robots = sorted({line["robot"] for line in stretches})
    found = {robot: [each for line in stretches if line["robot"] == robot for each in line["failed"]] for robot in robots}
    return {robot: failed[:QUESTIONS] for robot, failed in found.items()}


def answer_of(first_seed: int, robot: int, name: str, at: int, graphs: dict[str, tuple[Path, PolicyManifest]]) -> dict:
    """The line of one answer: what a user is told."""
    stretches = at // TRIALS[name] + 1
    _, made = trials_of(first_seed, robot, {each: manifest for each, (_, manifest) in graphs.items()}, stretches)
    began_s = time.process_time()
    trial = made[name][at]
    found = answer("leak", trial, explain(trial, NetworkInLoop(graphs[name][0]), effects=False)).for_users()
    told = {"verdict": found.verdict.value, "named": [group.name for group in found.groups]}
    return {"robot": robot, "policy": name, "trial": at} | told | {"cpu_s": round(time.process_time() - began_s, 1)}


def predicted(logs: np.ndarray, truth: np.ndarray, known: np.ndarray, of: int) -> np.ndarray:
    """The parameters of one robot, shape (parameters,), from its logs and what is known of others.

    A parameter is normal with covariance proportional to the products of robots' numbers and a penalty on the diagonal; of all
    scales the likeliest, and averaged over penalties by how likely the known robots are.
    """
    spread = logs[known].std(axis=0)
    scaled = (logs - logs[known].mean(axis=0)) / np.where(spread > 0, spread, np.inf)
    products, centre = scaled @ scaled.T / max(logs.shape[1], 1), truth[known].mean(axis=0)
    values, vectors = np.linalg.eigh(products[np.ix_(known, known)])
    along, to_other = vectors.T @ (truth[known] - centre), products[of, known] @ vectors
    likely, guesses = [], []
    for penalty in PENALTIES:
        spread = values.clip(0) + penalty
        scale = (along**2 / spread[:, None]).mean(axis=0)
        likely.append(-0.5 * len(values) * np.log(scale) - 0.5 * np.log(spread).sum())
        guesses.append(to_other @ (along / spread[:, None]))
    chances = np.array(likely)
    return centre + np.average(guesses, axis=0, weights=np.exp(chances - chances.max(axis=0)))


@dataclass(frozen=True)
class FromLogs:
    """What logs tell when one robot after the other is left out.

    ``guesses`` are its parameters, shape (robots, parameters); ``left`` is how far those of each other robot are from what its
    logs tell without both, shape (robots, robots, parameters).
    """

    guesses: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, logs: np.ndarray, truth: np.ndarray) -> "FromLogs":
        """From numbers of logs, shape (robots, numbers)."""
        robots = np.arange(len(truth))
        guesses, left = np.zeros_like(truth), np.zeros((len(truth), *truth.shape))
        for out in range(len(truth)):
            guesses[out] = predicted(logs, truth, robots[robots != out], out)
            for other in robots[robots != out].tolist():
                known = robots[(robots != out) & (robots != other)]
                left[out, other] = truth[other] - predicted(logs, truth, known, other)
        return cls(guesses, left)

    def with_answers(self, answers: np.ndarray) -> np.ndarray:
        """The guesses, moved by the one number of the answers that goes best with what is left, where that is no luck."""
        robots, guesses = np.arange(len(answers)), self.guesses.copy()
        count = len(robots) - 1
        least_t = stats.t.ppf(1 - LUCK / 2 / answers.shape[1], count - 2)
        least = least_t / np.sqrt(count - 2 + least_t**2)
        for out in robots:
            known = robots != out
            centre, spread = answers[known].mean(axis=0), answers[known].std(axis=0)
            scaled = (answers - centre) / np.where(spread > 0, spread, np.inf)
            left = self.left[out, known]
            slopes = scaled[known].T @ (left - left.mean(axis=0)) / count
            goes_with = slopes / left.std(axis=0)
            best = np.abs(goes_with).argmax(axis=0)
            each = np.arange(slopes.shape[1])
            is_told = np.abs(goes_with[best, each]) > least
            guesses[out] += np.where(is_told, slopes[best, each] * scaled[out, best], 0.0)
        return guesses


def compared(logs: FromLogs, answers: np.ndarray, truth: np.ndarray) -> dict:
    """Mean errors without and with answers, as shares of variances, and the 95 % interval of their difference over the robots.

    ``of_shuffled``: how often answers of other robots, dealt out by chance, gain as much.
    """
    rng = np.random.default_rng(24)

    def error(guesses: np.ndarray) -> np.ndarray:
        return ((guesses - truth) ** 2 / truth.var(axis=0)).mean(axis=1)

    without, together = error(logs.guesses), error(logs.with_answers(answers))
    gained = without - together
    means = gained[rng.integers(len(gained), size=(BOOTSTRAPS, len(gained)))].mean(axis=1)
    shuffled = [(without - error(logs.with_answers(rng.permutation(answers)))).mean() for _ in range(SHUFFLES)]
    return {
        "error_logs_alone": round(float(without.mean()), 4),
        "error_logs_and_answers": round(float(together.mean()), 4),
        "gained_by_answers": round(float(gained.mean()), 4),
        "interval_95": [round(float(each), 4) for each in np.quantile(means, (0.025, 0.975))],
        "of_shuffled": round(float(1 + sum(each >= gained.mean() for each in shuffled)) / (1 + SHUFFLES), 3),
    }


def shares(answers: list[dict]) -> np.ndarray:
    """Of one robot's answers: the share of each verdict and of each group."""
    count = max(len(answers), 1)
    verdicts = [sum(each["verdict"] == verdict for each in answers) / count for verdict in WhyVerdict]
    return np.array(verdicts + [sum(cause.name in each["named"] for each in answers) / count for cause in CAUSES])


def numbers_of(stretches: list[dict]) -> list[float]:
    """What the attacker read of one robot's logs, each number in the mean over the stretches."""
    names = next(line["logs"] for line in stretches if line["stretch"] == 0)
    return [float(np.mean([line["logs"][name] for line in stretches if name in line["logs"]])) for name in names]


def table(answers: list[dict]) -> dict:
    """How often what explains failed trials: count, share and its 95 % interval, of how many groups and of which."""
    kinds = [_KINDS[len(each["named"])] if each["named"] else each["verdict"] for each in answers]
    names = [*_KINDS[1:], *(verdict.value for verdict in WhyVerdict if verdict is not WhyVerdict.CAUSE)]
    groups = Counter(name for each in answers for name in each["named"])
    found = {"kinds": {kind: kinds.count(kind) for kind in names}, "groups": dict(groups.most_common())}
    return {"trials": len(answers)} | {
        name: {key: _share(count, len(answers)) for key, count in counts.items()} for name, counts in found.items()
    }


def _share(count: int, of: int) -> dict:
    low, high = wilson(count, of, 0.95)
    return {"trials": count, "share": round(count / max(of, 1), 3), "interval_95": [round(low, 3), round(high, 3)]}


def summary(lines: list[dict]) -> dict:
    """The two attackers, and the one whose answers leak."""
    logs = {line["robot"]: line for line in lines if "logs" in line and line["stretch"] == 0}
    told = {robot: [line for line in lines if line["robot"] == robot and "verdict" in line] for robot in logs}
    truth = np.array([list(line["truth"].values()) for line in logs.values()])
    varies = np.ptp(truth, axis=0) > 0  # two of `real` are the same on every robot
    keys, truth = (
        [key for key, is_told in zip(next(iter(logs.values()))["truth"], varies, strict=True) if is_told],
        truth[:, varies],
    )
    numbers = np.array([numbers_of([line for line in lines if line["robot"] == robot and "logs" in line]) for robot in logs])
    answers = np.array([shares(told[robot]) for robot in logs])
    scaled = (truth - truth.mean(axis=0)) / truth.std(axis=0)
    told_of = [3 * place % truth.shape[1] for place in range(answers.shape[1])]
    leaking = answers + PLANTED_SHARE * answers.std(axis=0) * scaled[:, told_of]
    of_logs, of_nothing = FromLogs.of(numbers, truth), FromLogs.of(np.zeros((len(logs), 1)), truth)
    without = ((of_logs.guesses - truth) ** 2 / truth.var(axis=0)).mean(axis=0)
    best = np.argsort(without)[:8]
    answered = [line for line in lines if "verdict" in line]
    return {
        "robots": len(logs),
        "answers": len(answered),
        "parameters": len(keys),
        "numbers_of_logs": numbers.shape[1],
        "numbers_of_answers": answers.shape[1],
        **compared(of_logs, answers, truth),
        "without_any_logs": compared(of_nothing, answers, truth),
        "with_a_leak_made": compared(of_logs, leaking, truth),
        "best_known_from_logs": {keys[at]: round(float(without[at]), 3) for at in best},
        "why_trials_failed": {
            "all": table(answered),
            **{name: table([line for line in answered if line["policy"] == name]) for name in TRIALS},
        },
    }


def main() -> int:
    """Run what is missing, as long as it may; or sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=Path, required=True)
    parser.add_argument("--robots", type=int, default=30)
    parser.add_argument("--answers", type=int, default=500)
    parser.add_argument("--first-seed", type=int, default=82_000)
    parser.add_argument("--for-s", type=float, default=float("inf"), help="begin nothing more after so long")
    parser.add_argument("--share", default="0/1", help="K/N: only each N-th of what is missing, for N processes and one file")
    parser.add_argument("--summary", type=Path)
    asked = parser.parse_args()
    lines = [json.loads(line) for line in asked.lines.read_text().splitlines()] if asked.lines.exists() else []
    if asked.summary is not None:
        found = {"first_seed": asked.first_seed} | summary(lines)
        asked.summary.write_text(json.dumps(found, indent=1) + "\n")
        print(json.dumps(found, indent=1))
        return 0
    until_s, (mine, shares_of) = time.monotonic() + asked.for_s, map(int, asked.share.split("/"))
    with tempfile.TemporaryDirectory() as folder:
        graphs = {name: graph_of(name, Path(folder)) for name in TRIALS}
        there = {(line["robot"], line["stretch"]) for line in lines if "logs" in line}
        done = {(line["robot"], line["policy"], line["trial"]) for line in lines if "verdict" in line}
        robots, most = range(mine, asked.robots, shares_of), max(STRETCHES.values())
        for stretch in range(most):
            for robot in robots:
                enough = stretch > 0 and len(failed_of(lines)[robot]) >= ENOUGH
                if (robot, stretch) not in there and not enough and time.monotonic() < until_s:
                    lines.append(logs_of(asked.first_seed, robot, stretch, graphs))
                    _keep(asked.lines, lines[-1])
            failed, places = failed_of(lines), range(QUESTIONS * (stretch + 1) // most)
            wanted = [(robot, *failed[robot][place]) for place in places for robot in robots if place < len(failed[robot])]
            for robot, name, at in wanted[: asked.answers // shares_of]:
                if (robot, name, at) not in done and time.monotonic() < until_s:
                    _keep(asked.lines, answer_of(asked.first_seed, robot, name, at, graphs))
                    done.add((robot, name, at))
    return 0


def _keep(path: Path, line: dict) -> None:
    with path.open("a") as file:
        file.write(json.dumps(line) + "\n")
    print({key: value for key, value in line.items() if key not in ("truth", "logs")}, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
