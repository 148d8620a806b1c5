"""Replay with small programs in the place of the simulator: what is passed on, and what goes to the server instead."""

import sys

import pytest

from api_schemas.trial import Verification
from tests.unit.client_cli.farm_server import JOB_ID

SAME = Verification(trial_id=f"{JOB_ID}-007", steps=15000, same=True, first_difference_step=None)
DIFFERENT = SAME.model_copy(update={"same": False, "first_difference_step": 88})
NEEDS_TRUTH = f"""
import sys
if "--truth" in sys.argv:
    print("compared here"); sys.exit(0)
if "--verify" in sys.argv:
    print("only the farm knows"); sys.exit(7)
print('{{"trial": {{"trial_id": "{JOB_ID}-007"}}}}')
"""


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "trial-007.mcap"
    path.write_bytes(b"the log")
    return path


@pytest.fixture
def replaying(monkeypatch):
    def use(program):
        command = lambda module, *rest: [sys.executable, "-c", program, module, *rest]  # noqa: E731
        monkeypatch.setattr("client_cli.commands.replay.module_command", command)

    return use


def test_the_exit_code_and_the_words_of_the_replay_are_passed_on(trifarm, log, tmp_path, replaying):
    seen = tmp_path / "seen"
    replaying(f"import sys; open({str(seen)!r}, 'w').write(' '.join(sys.argv[1:])); print('it differs'); sys.exit(6)")
    ended = trifarm("replay", str(log), "--verify", "--json")
    assert (ended.code, ended.out) == (6, "it differs\n")
    assert seen.read_text() == f"sim_backend.replays.replay {log} --verify --json"


@pytest.mark.parametrize(("verdict", "code", "said"), [(SAME, 0, "same numbers in all 15000"), (DIFFERENT, 6, "from step 88 on")])
def test_a_log_that_needs_the_truth_goes_to_the_server(farm, trifarm, log, replaying, verdict, code, said):
    replaying(NEEDS_TRUTH)
    farm.verdict, farm.busy = verdict, {"verifications": 1}  # another log of the owner is looked at first
    ended = trifarm("replay", str(log), "--verify")
    assert ended.code == code
    assert said in ended.out
    assert "only the farm knows" not in ended.out
    assert farm.verified == [(f"{JOB_ID}-007", b"the log")] * 2  # whole, also the second time
    assert trifarm("replay", str(log), "--verify", "--json").document == verdict.model_dump()


def test_operators_are_told_how_large_the_difference_is(farm, trifarm, log, replaying):
    replaying(NEEDS_TRUTH)
    farm.verdict = DIFFERENT.model_copy(update={"largest_joint_difference_rad": 0.25, "largest_cube_difference_m": 1e-3})
    assert "0.25 rad at the joints, 0.001 m at the cube" in trifarm("replay", str(log), "--verify").out


def test_a_given_truth_is_compared_here(farm, trifarm, log, tmp_path, replaying):
    replaying(NEEDS_TRUTH)
    truth = tmp_path / "trial-007.truth.mcap"
    truth.write_bytes(b"the truth")
    ended = trifarm("replay", str(log), "--verify", "--truth", str(truth))
    assert (ended.code, ended.out) == (0, "compared here\n")
    assert not farm.verified


@pytest.mark.parametrize("printed", ["", "no json", "{}", '{"trial": {"trial_id": "not of a farm"}}'])
def test_a_log_of_no_trial_cannot_be_sent(farm, trifarm, log, replaying, printed):
    replaying(f"import sys; print({printed!r}); sys.exit(7 if '--verify' in sys.argv else 0)")
    assert trifarm("replay", str(log), "--verify").code == 2
    assert not farm.verified


def test_an_absent_file_is_wrong_usage(trifarm, log):
    assert trifarm("replay", "absent.mcap").code == 2
    assert trifarm("replay", str(log), "--verify", "--truth", "absent.mcap").code == 2


def test_a_truth_alone_compares_nothing_and_is_refused(trifarm, log):
    ended = trifarm("replay", str(log), "--truth", str(log))
    assert ended.code == 2
    assert "--verify" in ended.err


def test_what_is_no_log_is_wrong_usage_with_one_line_and_one_document(trifarm, log):
    ended = trifarm("replay", str(log))
    assert (ended.code, ended.err) == (2, "error: trial-007.mcap cannot be read as a trial log: it is no MCAP file\n")
    ended = trifarm("replay", str(log), "--verify", "--json")
    assert ended.document["error"]["exit_code"] == ended.code == 2
    assert "no MCAP file" in ended.document["error"]["detail"]
