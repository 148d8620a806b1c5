"""Every program that measures something still runs: each is started with arguments by which it takes a few seconds."""

import importlib.util
import runpy
import shlex
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tests.browser.conftest import CHROMIUM

PROGRAMS = ROOT / "tests/benchmarks"
EXPERTS = ROOT.parent / "shared/data/policies"
PHOTOGRAPHS = ROOT.parent / "shared/data/trifinger_photos"
PUSH = "sim_backend/training/reference_policies/push.safetensors"
SCRATCH = "sim_backend/training/reference_policies/push-scratch.safetensors"
QUICK = {
    "anytime_figures": ["--runs 1000 --goals 40 --families 100 --rows 1 --out {to}/anytime.json"],
    "bench": ["--quick --parts bare --out {to}/figures.json"],
    "dispatch_cost": ["--robots 10 --out {to}/dispatch.json"],
    "foreign_policies": ["--kinds 'ONNX in one file' --out {to}/foreign.json"],
    "form_outcomes": [
        f"run --checkout {ROOT} --experts {{experts}} --goals 2 --policies push-adr --to {{to}}/goals.jsonl",
        "compare --old {to}/goals.jsonl --new {to}/goals.jsonl --out {to}/outcomes.json",
    ],
    "gpu_rate": ["--backend cpu --robots 16 --real --seconds 0.2 --compared 2 --out {to}/rate.json"],
    "http_document": ["{document} {document}"],
    "record_observations": ["--out {to}/recorded.safetensors"],
    "shipped_policy": [f"{PUSH} --task push --trials 1 --farm-seeds 7001 --physics-step 0.004 --out {{to}}/policy.json"],
    "verdict_times": ["--uploads 1 --out {to}/verdicts.json"],
}
"""Each program's command lines, one after the other."""
LARGER = {
    "against": [f"{ROOT} --rounds 1 --out {{to}}/rounds.jsonl --summary {{to}}/summary.json"],
    "attacked_farm": ["--pairs 1 --attack 'spin for ever' --out {to}/attacked.json"],
    "bench": ["--quick --out {to}/figures.json"],
    "claim_cost": ["--many 1000 --claims 5 --out {to}/cost.json"],
    "crowd": ["--jobs 40 --trials 1 --minutes 0.001 --out {to}/crowd.json"],
    "crowd_memory": ["--seconds 1 --out {to}/memory.json"],
    "dashboard_pages": ["--jobs 100 --seconds 0.1 --out {to}/pages.json"],
    "failure_sentences": [
        "run --robots 1 --farm-seed 1 --first-seed 1 --share 0.01 --folder {to}/logs --out {to}/failed.jsonl",
    ],
    "full_disk": ["--mb 40 --physics nominal --out {to}/disk.json"],
    "full_path": ["--trials 1"],
    "grasp_controller": ["--trials 1 --tasks move_cube_1 --out {to}/grasp.json"],
    "image_farm": ["--trials 1 --physics nominal --trackers images --out {to}/farm.json"],
    "image_trackers": [
        "renders --rows {to}/rows.jsonl --robots 1 --scenes 1 --reference-every 10",
        "tables --rows {to}/rows.jsonl --out {to}/tables.json",
    ],
    "killed_workers": ["--samples 100000 --kill-every-s 30 --checkpoint-minutes 0.01 --out {to}/killed.json"],
    "large_job": ["--homes embedded --trials 1200 --watch-s 0.5 --out {to}/large.json"],
    "leak": ["--lines {to}/leak.jsonl --robots 2 --answers 2 --for-s 20"],
    "learning_rate": ["--robots 16 --threads 1 --blocks 1 --periods 10 --iterations 1 --recipes push --out {to}/rates.json"],
    "page_pictures": ["--pictures {to}/pictures --out {to}/pages.json"],
    "peer_fields": ["--tasks push --seeds 5 --presses 0 --out {to}/fields.json"],
    "peer": ["--experts {experts} --episodes 1 --tasks push --steps 50 --out {to}/peer.json"],
    "peer_ppo": [
        "--rows {to}/rows.jsonl --out {to}/ppo.json --seeds 1 --samples 4096 --every 2048 --goals 4 --robots 64 --threads 1"
    ],
    "photograph_trackers": ["{photos} --out {to}/photographs.json"],
    "planted_causes": ["--planted 1 --hopeless 0 --for-s 20 --out {to}/planted.jsonl"],
    "pods": ["ends --trials 2 --out {to}/ends.json", "scaling --out {to}/scaling.json"],
    "published_experts": ["band --experts {experts} --trials 1 --out {to}/band.json"],
    "questions_on_farm": [f"{PUSH} {SCRATCH} --seeds 1 --max 2 --robots 1 --out {{to}}/questions.jsonl"],
    "replay_opening": ["--out {to}/opening.json"],
    "rollouts_behind": ["--seeds 1 --samples 4096 --final-trials 2 --workers 1 --out {to}/behind.json"],
    "same_bits": [
        f"record --checkout {ROOT} --to {{to}}/farm --trials 1 --physics nominal",
        "compare {to}/farm/results {to}/farm/results",
    ],
    "second_renderer": ["--robots 1 --scenes 1 --out {to}/second.json"],
    "seeing_experts": ["--experts {experts} --rows {to}/rows.jsonl --out {to}/seeing.json --goals 1 --budget-s 5"],
    "sheet_cost": ["--trials 1 --out {to}/sheet.json"],
    "study_time": ["--seconds 2 --cases healthy --folder {to}/study --out {to}/study-time.json"],
    "success_gain_oracle": ["--experts {experts} --trials 2 --out {to}/gain.json"],
    "thousand_robots": ["--robots 5 --homes embedded --within-s 1 --rest-s 1 --work-s 1 --out {to}/robots.json"],
    "two_homes": ["--trials 1 --jobs 1 --out {to}/homes.json"],
    "two_hosts": ["--trials 1 --robots 1 --out {to}/hosts.json"],
    "update_farm": [f"{ROOT} --python {sys.executable} --homes embedded --out {{to}}/update.json"],
    "update_cost": ["--iterations 1 --robots 16 --out {to}/update.json"],
    "watching_cost": ["--pairs 1 --out {to}/watching.json"],
    "workers_cost": ["--robots 16 --slices 2 --steps 2 --rounds 1 --without-ray --out {to}/workers.json"],
    "wrong_layouts": ["--experts {experts} --most 1 --out {to}/wrong.json"],
}
MAY_MISS = {"attacked_farm", "crowd", "crowd_memory", "shipped_policy", "verdict_times"}
"""Programs that end with 1 where a figure misses its limit, as it may in so short a run."""
ELSEWHERE = {
    "attacking_robot_policy": "tests/benchmarks/attacked_farm.py",
    "in_checkout": "tests/benchmarks/against.py",
    "lerobot_policies": "tests/benchmarks/foreign_policies.py",
    "peer_episode": "tests/benchmarks/peer.py",
    "pybullet_renders": "tests/benchmarks/second_renderer.py",
    "peer_fields_episode": "tests/benchmarks/peer_fields.py",
    "robots_of_a_host": "tests/unit/benchmarks/test_robots_of_a_host.py",
    "swarm": "tests/benchmarks/thousand_robots.py",
    "turned_policy": "tests/unit/benchmarks/test_turned_policy.py",
}
"""Who starts the other programs."""


NEEDS = {
    "killed_workers": ("ray", "torch"),
    "learning_rate": ("torch",),
    "peer_ppo": ("rsl_rl",),
    "update_cost": ("torch",),
    "workers_cost": ("torch",),
}
"""Of the optional packages."""


def why_not(name: str, lines: list[str]) -> str | None:
    """What a program needs and this machine lacks."""
    if any("{experts}" in line for line in lines) and not EXPERTS.is_dir():
        return "the published experts are not beside this checkout (../shared/data/policies)"
    if any("{photos}" in line for line in lines) and not PHOTOGRAPHS.is_dir():
        return "the photographs are not beside this checkout (../shared/data/trifinger_photos)"
    for needed in NEEDS.get(name, ()):
        if importlib.util.find_spec(needed) is None:
            return f"{needed} is not installed"
    if name in ("replay_opening", "page_pictures") and not Path(CHROMIUM).exists():
        return f"there is no {CHROMIUM}"
    if name in ("peer", "peer_fields"):
        from tests.benchmarks.peer import missing

        return missing(EXPERTS, make=False)
    return None


def started(name, words, monkeypatch):
    """Runs a program in this process, whose libraries are loaded already; gives its exit code."""
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    try:
        runpy.run_path(str(PROGRAMS / f"{name}.py"), run_name="__main__")
    except SystemExit as ended:
        if isinstance(ended.code, str):
            pytest.skip(ended.code)
        return ended.code or 0
    return 0


def try_program(name, lines, folder, monkeypatch, capsys):
    """Runs its command lines; each ends as it should, says something and writes the files that it was told to write."""
    if (reason := why_not(name, lines)) is not None:
        pytest.skip(reason)
    document = folder / "openapi.json"
    document.write_text('{"paths": {}, "components": {"schemas": {}}}')
    monkeypatch.chdir(ROOT)
    for line in lines:
        words = shlex.split(line.format(to=folder, experts=EXPERTS, photos=PHOTOGRAPHS, document=document))
        assert started(name, words, monkeypatch) in ({0, 1} if name in MAY_MISS else {0})
        assert capsys.readouterr().out.strip(), f"{name} said nothing"
        written = [Path(word) for word in words if word.startswith(str(folder)) and Path(word).suffix]
        assert all(path.stat().st_size for path in written)


@pytest.mark.parametrize("name", QUICK)
def test_a_program_runs_and_says_what_it_found(name, tmp_path, monkeypatch, capsys):
    try_program(name, QUICK[name], tmp_path, monkeypatch, capsys)


@pytest.mark.scale
@pytest.mark.parametrize("name", LARGER)
def test_a_program_that_takes_longer_runs(name, tmp_path, monkeypatch, capsys):
    """As `test_a_program_runs_and_says_what_it_found`, for programs that need farms, browsers, databases or many seconds."""
    try_program(name, LARGER[name], tmp_path, monkeypatch, capsys)


def test_no_program_is_left_out():
    programs = {path.stem for path in PROGRAMS.glob("*.py") if "__main__" in path.read_text()}
    assert programs == {*QUICK, *LARGER, *ELSEWHERE}
    for name, starter in ELSEWHERE.items():
        assert name in (ROOT / starter).read_text(), f"{starter} does not start {name}"
