import time

import pytest

from services.errors import Refused, Unavailable
from services.verification import replaying


@pytest.fixture
def verify(tmp_path, monkeypatch):
    monkeypatch.setattr(replaying, "REPLAY", "tests.unit.services.verification.replay_program")
    (tmp_path / "truth.mcap").write_text("j-000")

    async def of(does, deadline_s=30.0):
        (tmp_path / "log.mcap").write_text(does)
        return await replaying.verify(tmp_path / "log.mcap", tmp_path / "truth.mcap", deadline_s)

    return of


async def test_the_same_numbers(verify):
    verdict = await verify("same")
    assert (verdict.trial_id, verdict.same, verdict.first_difference_step, verdict.steps) == ("j-000", True, None, 9)


async def test_other_numbers(verify):
    verdict = await verify("different")
    assert (verdict.same, verdict.first_difference_step, verdict.largest_joint_difference_rad) == (False, 3, 0.5)


async def test_a_log_that_cannot_be_read_is_a_refusal(verify):
    with pytest.raises(Refused, match="the log has gaps"):
        await verify("unreadable")


@pytest.mark.parametrize("does", ["crash", "garbage"])
async def test_a_replay_that_breaks_is_not_the_users_fault(verify, does):
    with pytest.raises(Unavailable, match="the replaying process ended with status"):
        await verify(does)


async def test_a_replay_that_takes_too_long_is_ended(verify):
    began_s = time.monotonic()
    with pytest.raises(Unavailable, match="more than 1 s"):
        await verify("hang", 1.0)
    assert time.monotonic() - began_s < 30


async def test_the_process_is_limited(verify):
    with pytest.raises(Refused, match=r"limits \[7, 0\]"):
        await verify("limits", 6.5)
