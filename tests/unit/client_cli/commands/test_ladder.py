import pytest

from client_cli.policies.checkpoints import find_checkpoints
from client_cli.terminal.errors import UsageProblem
from tests.unit.client_cli.farm_server import LADDER_ID


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "ppo-push"
    made.mkdir()
    for step in (100, 20, 3):
        (made / f"policy_2_{step}.onnx").write_bytes(b"weights %d" % step)
    (made / "notes.txt").write_text("not a policy")
    return made


@pytest.mark.parametrize(
    ("names", "steps"),
    [
        (["lift_2_final_100", "lift_2_final_200"], [100, 200]),
        (["seed1_step100_v2", "seed1_step200_v2"], [100, 200]),
        (["a500k", "a1.5M", "a20"], [20, 500_000, 1_500_000]),
        (["ppo2-10", "ppo2-final3"], [3, 10]),
        (["10_steps_5kg", "20_steps_5kg"], [10, 20]),
        (["only7"], [7]),
    ],
)
def test_the_number_is_the_last_by_which_names_differ(tmp_path, names, steps):
    for name in names:
        (tmp_path / f"{name}.safetensors").write_bytes(b"x")
    assert [each.step for each in find_checkpoints(tmp_path)] == steps


@pytest.mark.parametrize(("names", "words"), [([], "holds no policy"), (["best", "a1"], "best.onnx has no number")])
def test_what_makes_no_ladder_is_said(tmp_path, names, words):
    for name in names:
        (tmp_path / f"{name}.onnx").write_bytes(b"x")
    with pytest.raises(UsageProblem, match=words):
        find_checkpoints(tmp_path)


def test_a_folder_becomes_one_ladder_by_step(farm, trifarm, folder):
    ended = trifarm("submit", str(folder), "--layout", "pose", "--task", "lift", "--trials", "5", "--idempotency-key", "mine")
    assert (ended.code, ended.out) == (0, f"{LADDER_ID}\n")
    assert farm.uploads == ["policy_2_3.onnx", "policy_2_20.onnx", "policy_2_100.onnx"]
    ((request, key),) = farm.ladders
    assert (request.name, request.task, request.trials, request.seed, key) == ("ppo-push", "lift", 5, None, "mine")
    assert [rung.step for rung in request.rungs] == [3, 20, 100]
    assert not farm.submissions


def test_waiting_for_a_ladder_ends_with_its_last_job(farm, trifarm, folder):
    farm.ladder_looks = 2
    ended = trifarm("submit", str(folder), "--layout", "pose", "--task", "lift", "--wait", "--json")
    assert ended.code == 0
    assert [rung["state"] for rung in ended.document["rungs"]] == ["succeeded"] * 3
    assert farm.ladder_looks == 0


def test_a_ladder_is_a_table(farm, trifarm, folder):
    trifarm("submit", str(folder), "--layout", "pose", "--task", "lift")
    lines = trifarm("ladder", LADDER_ID).out.splitlines()
    assert lines[0] == "ppo-push: lift, 3 rungs × 40 trials, seed 7 (drawn by the farm)"
    assert [line.split()[0] for line in lines[1:]] == ["step", "3", "20", "100"]
    assert "20 of" not in lines[2] and "50 %" in lines[2]


def test_nothing_is_sent_of_a_folder_with_a_bad_policy(farm, trifarm, folder):
    (folder / "policy_2_7.onnx").write_bytes(b"")
    ended = trifarm("submit", str(folder), "--layout", "pose", "--task", "lift")
    assert ended.code == 2
    assert not farm.uploads


def test_a_webhook_is_of_one_job_and_of_https(farm, trifarm, folder):
    flags = ("--layout", "pose", "--task", "lift", "--webhook")
    several = trifarm("submit", str(folder), *flags, "https://a.example/")
    assert (
        several.code == 2 and "a folder makes several jobs" in several.err and "--webhook" in several.err.partition("and no")[2]
    )
    refused = trifarm("submit", str(folder / "policy_2_3.onnx"), *flags, "http://a.example/")
    assert refused.code == 2 and "begins with https://" in refused.err
    assert not farm.uploads
    assert trifarm("submit", str(folder / "policy_2_3.onnx"), *flags, "https://a.example/").code == 0
    assert farm.submissions[0][0].webhook == "https://a.example/"


@pytest.mark.parametrize(("step_from", "steps"), [("ep", [3, 12]), (r"seed(\d+)", [1, 2]), ("step", [5000, 20000])])
def test_any_number_of_the_name_may_order_a_ladder(step_from, steps, tmp_path):
    for name in ("seed1_ep12_step5k", "seed2_ep3_step20k"):
        (tmp_path / f"{name}.onnx").touch()
    assert [each.step for each in find_checkpoints(tmp_path, step_from)] == steps


@pytest.mark.parametrize(("step_from", "words"), [("epoch", "has no such number"), ("(", "is no pattern with one group")])
def test_a_number_that_is_not_there_is_said(step_from, words, tmp_path):
    (tmp_path / "seed1_ep12.onnx").touch()
    with pytest.raises(UsageProblem, match=words):
        find_checkpoints(tmp_path, step_from)
