"""Reports are made page by page, and those of jobs that were made at once are the same bits as ever."""

import hashlib
import json
import random
from types import SimpleNamespace

from api_schemas.trial import Outcome
from services.jobs import reports

GOLDEN = "c2dfddd86604b2fa7951f3edb8050b217753afe3f356f1ed814fc0c9a0f4af39"
"""Of the report below as version 0.2's code before large jobs composed it (commit d2143f4)."""


def job_of(trials, **more):
    times = {"created_at": "2026-11-25T20:00:00+00:00", "started_at": "2026-11-25T20:00:01+00:00"}
    said = {"job_id": "jaaaaaaaaaaaa", "task": "push", "object": "cube", "object_scale": 1.0, "policy": "d" * 64, "seed": 7}
    said |= {"policy_name": "p", "trials": trials, "judged": False, "trials_done": trials, "own_goals": False, "recipe": None}
    return SimpleNamespace(**times, ended_at="2026-11-25T20:10:00+00:00", training_seed=None, **said | more)


def outcome(draw, ordinal):
    kind, fault = draw.choices([("succeeded", "none"), ("failed", "none"), ("policy_error", "policy")], (5, 3, 1))[0]
    said = {"kind": kind, "fault": fault, "reason": f"said {ordinal}", "wall_s": draw.random(), "form": draw.choice("ab")}
    if kind != "policy_error":
        ended = {"success_at_end": kind == "succeeded", "success_ever": draw.random() < 0.8, "success_fraction": draw.random()}
        ended |= {"final_position_error_m": draw.random(), "final_angle_error_rad": None, "episode_return": -draw.random()}
        said["measures"] = ended | {"control_steps": 500, "simulated_s": 10.0}
        late = draw.randrange(9)
        timing = {"mean_ms": 1.0, "p99_ms": 2 * draw.random(), "max_ms": 3 + draw.random(), "allowed_ms": 11.0, "missed": late}
        said["policy_timing"] = timing
        said["jail"] = {"level": draw.choice(["limits", "filesystem"]), "layers": ["limits"]}
    if kind == "failed":
        said["failure"] = {"kind": draw.choice(["late", "left"]), "sentence": f"failed so {ordinal}", "at_s": 1.5}
    return Outcome.model_validate(said).model_dump_json()


def rows_of(trials):
    """Trials and attempts as the database gives them, some attempts of them failed by the platform."""
    draw = random.Random(5)
    made, tried = [], []
    for ordinal in range(trials):
        trial_id, robot = f"jaaaaaaaaaaaa-{ordinal:03d}", f"robot-{draw.randrange(7)}"
        own = {"trial_id": trial_id, "ordinal": ordinal}
        faults = draw.choice([0, 0, 0, 1])
        for fence in range(1, faults + 1):
            tried.append(
                SimpleNamespace(**own, fence=fence, robot="robot-9", state="platform_fault", reason="lost", departure=None)
            )
        departure = draw.choice([None, "the first was busy"])
        tried.append(SimpleNamespace(**own, fence=faults + 1, robot=robot, state="accepted", reason="", departure=departure))
        told = {"robot": robot, "seed": draw.getrandbits(60), "outcome": outcome(draw, ordinal), "log_sha256": f"{ordinal:064x}"}
        made.append(SimpleNamespace(**own, **told))
    return made, tried


def bits(report):
    return json.dumps(report.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def test_a_report_is_the_same_bits_as_ever():
    made, tried = rows_of(300)
    body = bits(reports.compose(job_of(300), made, tried, {"trifarm": "0.2.0"}))
    assert hashlib.sha256(body).hexdigest() == GOLDEN
