"""Questions why trials failed: asked once, answered once, and a user's end for each robot."""

import json

import pytest
from sqlalchemy import insert, update

from api_schemas.trial import TrialState
from api_schemas.why import Why, WhyGroup, WhyState, WhyVerdict
from services.database.tables import job, policy, trial
from services.errors import Conflict, NotFound, TooMany
from services.jobs import whys
from services.jobs.lists import trial_row
from tests.unit.services.dispatcher.conftest import JOB, POLICY

BUDGET = whys.Budget(per_robot=2)
NOW_S = 1000.0
SHA = "e" * 64
GROUP = WhyGroup(name="late_camera", words="a late camera", explains=True, turned=True, successes=4, replays=4)
FOUND = Why(
    trial="j1-000", verdict=WhyVerdict.CAUSE, groups=(GROUP,), control_successes=0, control_replays=4, effects=(), replays=9
)


@pytest.fixture
async def database(new_database):
    kinds = ["failed"] * 4 + ["succeeded"]
    rows = [
        {"trial_id": f"j1-{number:03d}", "job_number": 1, "owner": "o", "ordinal": number, "state": TrialState.DONE, "seed": 1}
        | {"robot": "robot-0", "outcome": json.dumps({"kind": kind}), "log_sha256": SHA, "truth_sha256": SHA}
        for number, kind in enumerate(kinds)
    ]
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(job).values(JOB))
        await tx.execute(insert(trial), rows)
        gone = {"trial_id": "j1-005", "ordinal": 5, "truth_sha256": None, "outcome": json.dumps({"kind": "failed"})}
        await tx.execute(insert(trial), [rows[0] | gone])
    return new_database


async def ask(database, number, *, as_operator=False):
    async with database.write() as tx:
        row = await trial_row(tx, f"j1-{number:03d}")
        assert row is not None
        await whys.ask(tx, row, BUDGET, NOW_S, as_operator=as_operator)
        return await whys.show(tx, row, BUDGET, as_operator=as_operator)


async def test_a_question_is_computed_once_and_shown_to_each_as_they_may_see_it(database):
    assert (await ask(database, 0)).state is WhyState.QUEUED
    async with database.write() as tx:
        taken = await whys.take(tx, NOW_S, held_s=60.0)
        assert taken is not None
        assert (taken.trial_id, taken.log_sha256, taken.graph_sha256) == ("j1-000", SHA, "g" * 64)
        assert await whys.take(tx, NOW_S, held_s=60.0) is None
        await whys.answer(tx, "j1-000", FOUND, None)
    own, operators = await ask(database, 0), await ask(database, 0, as_operator=True)
    assert (own.state, own.questions_left, own.why) == (WhyState.DONE, 1, FOUND.for_users())
    assert (operators.why, operators.questions_left) == (FOUND, None)
    async with database.read() as connection:
        assert not await whys.any_due(connection, NOW_S + 1e6)


async def test_beyond_the_budget_a_user_is_told_why_and_may_read_what_is_there(database):
    assert (await ask(database, 0)).questions_left == 1
    await ask(database, 1)
    await ask(database, 1)  # again costs nothing
    with pytest.raises(TooMany) as refused:
        await ask(database, 2)
    assert (refused.value.slug, refused.value.members["limit"]) == ("why-budget-used", 2)
    assert "hidden physics" in refused.value.detail
    assert (await ask(database, 0)).state is WhyState.QUEUED
    assert (await ask(database, 2, as_operator=True)).state is WhyState.QUEUED
    with pytest.raises(TooMany):  # what an operator had computed costs a question, too
        await ask(database, 2)


async def test_what_an_operator_asked_is_not_shown_to_the_owner(database):
    await ask(database, 0, as_operator=True)
    async with database.read() as connection:
        row = await trial_row(connection, "j1-000")
        assert row is not None
        with pytest.raises(NotFound, match="Nobody has asked"):
            await whys.show(connection, row, BUDGET, as_operator=False)


async def test_owners_take_turns_however_many_questions_one_has(database):
    """Each takes minutes: whoever asks one question must not wait for all of another's."""
    async with database.write() as tx:
        await tx.execute(update(trial).where(trial.c.ordinal == 3).values(owner="later"))
    for number in (0, 1, 2, 3):
        await ask(database, number, as_operator=True)
    taken = []
    for turn in range(4):
        async with database.write() as tx:
            row = await whys.take(tx, NOW_S + turn, held_s=60.0)
            taken.append(row.trial_id)
            await whys.answer(tx, row.trial_id, FOUND, None)
    assert taken == ["j1-000", "j1-003", "j1-001", "j1-002"]


@pytest.mark.parametrize(("number", "slug"), [(4, "nothing-to-explain"), (5, "truth-gone")])
async def test_there_must_be_something_to_explain(database, number, slug):
    with pytest.raises(Conflict) as refused:
        await ask(database, number)
    assert refused.value.slug == slug


async def test_a_question_whose_process_is_gone_is_due_again_and_then_given_up(database):
    await ask(database, 0)
    for tries in range(whys.MOST_TRIES):
        async with database.write() as tx:
            assert await whys.take(tx, NOW_S + 100 * tries, held_s=50.0) is not None
    async with database.write() as tx:
        assert await whys.take(tx, NOW_S + 1000, held_s=50.0) is None
    found = await ask(database, 0)
    assert found.state is WhyState.FAILED and "ended 2 times" in (found.problem or "")
