"""Sentences of failed trials beside what the truth shows, so that somebody can judge them one by one.

    python -m tests.benchmarks.failure_sentences run --farm-seed 2407 --first-seed 701 --folder DIR --out FILE.jsonl
    python -m tests.benchmarks.failure_sentences show FILE.jsonl
    python -m tests.benchmarks.failure_sentences again FILE.jsonl --folder DIR
    python -m tests.benchmarks.failure_sentences keep FILE.jsonl JUDGED.json --farm-seed 2407 --out results/failure-sentences.json

``run`` starts a `real` farm, sends the jobs of ``JOBS`` and keeps of each failed trial its sentence and curves of the truth:
error, height, gaps of the fingertips, the tracker's error and confidence, the largest torque. ``show`` prints the trials that are
judged, the first of each job in turn until there are enough. ``again`` tells the sentences of the same logs by the rules of now.
``keep`` puts sentences and judgements, ``{"POLICY TASK SEED TRIAL": [right, "what was seen"]}``, into the list as one more round.
Pictures and videos of the folder's logs (``trifarm look``, ``trifarm video``) help where curves do not.
"""

import argparse
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np

from client_cli.connection.log_download import log_name, truth_name
from sim_backend.evidence import why_of_log
from sim_backend.tasks.keypoints import angle_between_rad
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.objects import CUBE
from tests.benchmarks.graphs import SHIPPED
from tests.benchmarks.questions_on_farm import wait_for
from tests.end_to_end import farm as of_farm
from trial_logs.moments import in_object, surface_distance
from trial_logs.reader import read_log, read_truth

JOBS = (
    ("push-scratch", "push", 14),
    ("push-adr", "push", 20),
    ("push-recurrent", "push", 12),
    ("lift", "lift", 12),
    ("push", "move_cube_1", 10),
    ("builtin:grasp", "lift", 8),
    ("builtin:grasp", "move_cube_3", 12),
    ("builtin:grasp-turn", "floor_pose", 8),
    ("builtin:grasp-turn", "move_cube_4", 8),
)
"""Policy, task and trials; each job has the seed after that of the one before."""
JUDGED = 60
LOOKS = 16


def curves(log_path: Path, truth_path: Path) -> list[list[float]]:
    """Of the truth, at even times: s; error, mm and degrees; height above the start, gaps of the fingertips, error of the tracker
    and its age, mm and ms; confidence; the largest torque as a share of the limit."""
    log, truth = read_log(log_path), read_truth(truth_path)
    goal_m, goal_quat = log.goal or (np.zeros(3), np.array([1.0, 0, 0, 0]))
    end_s = truth.cube_steps[-1] * c.PHYSICS_STEP_S
    rows = []
    for t_s in np.linspace(0, end_s, LOOKS):
        cube, joint = (int(np.searchsorted(steps, t_s * 1e3 - 0.5)) for steps in (truth.cube_steps, truth.joint_steps))
        cube, joint = min(cube, len(truth.cube_steps) - 1), min(joint, len(truth.joint_steps) - 1)
        place_m, quat = truth.cube_position_world_m[cube], truth.cube_quat_wxyz[cube]
        tips = fingertip_position_world_m(truth.joint_position_rad[joint][None]).reshape(1, 3, 3)
        pose = np.concatenate([place_m, quat])[None]
        gap_m = surface_distance(in_object(tips, pose), np.array(CUBE.size_m) / 2, is_ball=False)[0] - c.TIP_RADIUS_M
        seen = max(int(np.searchsorted(log.delivery_s, t_s, side="right")) - 1, 0)
        then = min(int(np.searchsorted(truth.cube_steps, log.capture_s[seen] * 1e3)), len(truth.cube_steps) - 1)
        off_m = np.linalg.norm(log.tracked_position_world_m[seen] - truth.cube_position_world_m[then])
        last = slice(max(0, int(t_s * 1e3) - 200), int(t_s * 1e3) + 1)
        torque = np.abs(log.applied_torque_nm[last]).mean(axis=0).max() / c.MAX_TORQUE_NM
        row = [t_s, 1e3 * np.linalg.norm(place_m - goal_m), np.rad2deg(float(angle_between_rad(quat, goal_quat)))]
        row += [1e3 * (place_m[2] - truth.cube_position_world_m[0, 2]), *(1e3 * gap_m), 1e3 * off_m]
        row += [1e3 * (t_s - log.capture_s[seen]), 100 * log.confidence[seen], 100 * torque, 1e3 * np.linalg.norm(place_m[:2])]
        rows.append([round(float(each), 1) for each in row])
    return rows


def named(policy: str) -> str:
    """As ``trifarm submit`` takes it."""
    return policy if policy.startswith("builtin:") else str(SHIPPED / f"{policy}.safetensors")


def run(asked: argparse.Namespace) -> None:
    """Send all jobs, and keep their failed trials as they are done."""
    of_farm.READY_WITHIN_S = 900  # other work may have the cores
    more = ("--physics", "real", "--farm-seed", asked.farm_seed)
    with of_farm.Farm(asked.folder, robots=asked.robots, more=more) as farm:
        sent = []
        for place, (policy, task, trials) in enumerate(JOBS):
            seed, count = asked.first_seed + place, math.ceil(asked.share * trials)
            sent.append((farm.submit(named(policy), task=task, trials=count, seed=seed), policy, task, seed))
        for job, policy, task, seed in sent:
            wait_for(farm, job)
            to = asked.folder / f"{policy.replace(':', '-')}-{task}-{seed}"
            farm.run("fetch", job, "--to", str(to), "--truth")
            lines = of_job(to, policy, task, seed)
            with asked.out.open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in lines)
            print(policy, task, len(lines), flush=True)


def of_job(folder: Path, policy: str, task: str, seed: int) -> list[dict]:
    """The failed trials of a job whose logs and truths lie in a folder."""
    found = []
    for path in sorted(folder.glob("trial-???.mcap")):
        log = read_log(path)
        why = why_of_log(log)
        if log.outcome.get("kind") != "failed" or why is None:
            continue
        truth = path.with_name(truth_name(int(log.metadata["ordinal"])))
        line = {"policy": policy, "task": task, "job_seed": seed, "trial": int(log.metadata["ordinal"])}
        line |= {"robot": log.metadata["robot"], "kind": why.kind, "sentence": why.sentence, "told": told_by_robot(log.outcome)}
        found.append(line | {"curves": curves(path, truth)})
    return found


def judged_of(lines: list[dict]) -> list[dict]:
    """The trials that are judged: the first failure of each job, then the second of each, until there are enough."""
    places, seen = [], Counter()
    for line in lines:
        places.append(seen[line["job_seed"]])
        seen[line["job_seed"]] += 1
    first = sorted(range(len(lines)), key=lambda at: (places[at], at))[:JUDGED]
    return [lines[at] for at in sorted(first)]


def told_by_robot(outcome: dict[str, str]) -> str:
    """The sentence in the log; that of the same rules, told while the trial ran."""
    return (json.loads(outcome.get("failure", "null")) or {}).get("sentence", "")


def show(lines: list[dict]) -> None:
    """Print each trial's sentence above its curves."""
    for line in lines:
        print(f"\n{key_of(line)} ({line['robot']}, {line['kind']}): {line['sentence']}")
        print("     s    mm   deg    up | gaps mm          | seen mm  age ms conf torque from middle")
        for row in line["curves"]:
            print(
                "{:6.1f} {:5.0f} {:5.0f} {:5.0f} | {:5.0f} {:5.0f} {:5.0f} | {:5.1f} {:5.0f} {:4.0f} {:5.0f} {:5.0f}".format(*row)
            )


def key_of(line: dict) -> str:
    """What a judgement names its trial by."""
    return f"{line['policy']} {line['task']} {line['job_seed']} {line['trial']}"


def main() -> None:
    """Does what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "show", "again", "keep"))
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--farm-seed", default="2407")
    parser.add_argument("--first-seed", type=int, default=701)
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of each job's trials")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--date", help="of the round, for keep")
    parser.add_argument("--rules", help="which rules told the sentences, for keep")
    asked = parser.parse_args()
    if asked.what == "run":
        run(asked)
        return
    lines = judged_of([json.loads(line) for line in asked.files[0].read_text().splitlines()])
    if asked.what == "again":
        for line in lines:
            to = asked.folder / f"{line['policy'].replace(':', '-')}-{line['task']}-{line['job_seed']}"
            why = why_of_log(read_log(to / log_name(line["trial"])))
            assert why is not None, "it failed before"
            if why.sentence != line["sentence"]:
                print(f"{key_of(line)}:\n  was {line['kind']}: {line['sentence']}\n  now {why.kind}: {why.sentence}")
    elif asked.what == "show":
        show(lines)
    else:
        judged = json.loads(asked.files[1].read_text())
        names = ("policy", "task", "job_seed", "trial", "robot", "kind", "sentence")
        trials = [
            {name: line[name] for name in names} | {"seen": judged[key_of(line)][1], "right": judged[key_of(line)][0]}
            for line in lines
        ]
        found = {"date": asked.date, "farm_seed": asked.farm_seed, "first_seed": min(line["job_seed"] for line in lines)}
        found |= {"rules": asked.rules, "judged": len(trials), "right": sum(each["right"] for each in trials), "trials": trials}
        before = json.loads(asked.out.read_text()) if asked.out.exists() else {"rounds": []}
        asked.out.write_text(json.dumps(before | {"rounds": [*before["rounds"], found]}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
