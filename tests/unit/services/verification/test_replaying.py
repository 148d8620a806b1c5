import os

import pytest

from services.errors import Refused, Unavailable
from services.verification import replaying


@pytest.fixture
def verify(tmp_path, monkeypatch):
    monkeypatch.setattr(replaying, "REPLAY", "tests.unit.services.verification.replay_program")
    files = replaying.Compared(*(tmp_path / f"{name}.mcap" for name in ("log", "truth", "original")))
    files.truth.write_text("j-000")
    files.original.write_text("the original")

    async def of(does, deadline_s=120.0, *, tell_all=False):
        files.log.write_text(does)
        return await replaying.verify(files, deadline_s, tell_all=tell_all)

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
    with pytest.raises(Unavailable, match="more than 1 s"):
        await verify("hang", 1.0)


async def test_the_process_is_limited(verify):
    niceness = min(os.nice(0) + 10, 19)
    with pytest.raises(Refused, match=rf"limits \[7, 0\], memory 3\.0 GiB, niceness {niceness}"):
        await verify("limits", 6.5)


async def test_a_replay_that_says_too_much_is_ended(verify):
    with pytest.raises(Unavailable, match="it said more than 65536 bytes"):
        await verify("shout")


async def test_only_operators_are_told_what_went_wrong_inside_the_simulation(verify):
    with pytest.raises(Unavailable, match="the farm's operator can find out why") as told:
        await verify("diverge")
    assert "421" not in told.value.detail
    with pytest.raises(Unavailable, match="at step 421"):
        await verify("diverge", tell_all=True)
