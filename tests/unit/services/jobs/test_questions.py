"""On each home: a question lets goals in by and by, is answered goal by goal, and ends its jobs."""

import json

import pytest
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest, TaskName
from api_schemas.question import QuestionRequest, Verdict
from api_schemas.report import read_report
from api_schemas.robot import OutcomeReport
from api_schemas.trial import Fault, Outcome, OutcomeKind, TrialState
from services.database.tables import job, policy, report, trial
from services.dispatcher.finding import find_trial
from services.errors import Conflict, NotFound, Refused
from services.jobs import cancellation, completion, goals, judging, leaderboard, lease, questions, requeue, robots, submission
from services.jobs.leaderboard import Wanted
from services.jobs.submission import Sender
from tests.unit.services.conftest import beat, leased_to

A, B = "a" * 64, "b" * 64
ROBOTS = ("r0", "r1")
PUSH = TaskName.PUSH


@pytest.fixture
async def database(new_database):
    kept = {"weights_format": "onnx", "weights_sha256": A, "weights_bytes": 1, "graph_sha256": A, "manifest": "{}"}
    kept |= {"warnings": "[]", "owner": "ann", "created_at": "now"}
    async with new_database.write() as tx:
        await tx.execute(insert(policy), [kept | {"digest": digest, "name": digest[0]} for digest in (A, B)])
        for robot in ROBOTS:
            await robots.keep(tx, [beat(robot).model_copy(update={"physics": "real", "physics_digest": "1" * 32})], 1000.0)
    return new_database


async def submit(database, digest=B, **asked):
    async with database.write() as tx:
        return (await submission.submit(tx, 1000.0, JobRequest(policy=digest, task=PUSH, **asked), Sender("ann")))[0]


async def rows(database, table=job):
    async with database.read() as connection:
        return (await connection.execute(select(table).order_by(*table.primary_key))).all()


async def move(database):
    async with database.write() as tx:
        return [
            ended
            for row in await questions.open_ones(tx)
            for ended in await judging.move(tx, 1000.0, row.job_number, set(ROBOTS))
        ]


async def run(database, fleet_of, ends, robot="r0"):
    """Trials on the robot until nothing is queued; a policy's trial of a goal ends as ``ends(digest, ordinal)`` says."""
    done = 0
    while True:
        await move(database)
        async with database.write() as tx:
            found = await find_trial(tx, robot, fleet_of(*ROBOTS).seen(1000.0))
            if found is None:
                return done
            claim = await leased_to(tx, 1000.0, found[0], robot, departure=found[1], lease_s=15.0)
            await lease.keep_file(tx, claim.trial_id, claim.fence, "log", A)
            succeeded = ends(found[0].policy, found[0].ordinal)
            outcome = Outcome(kind=OutcomeKind.SUCCEEDED if succeeded else OutcomeKind.FAILED, fault=Fault.NONE, reason="r")
            told = OutcomeReport(robot=robot, fence=claim.fence, outcome=outcome, log_sha256=A)
            await completion.accept(tx, 1000.0, claim.trial_id, told, log_bytes=1, max_attempts=5)
        done += 1


async def both_robots(database, fleet_of, ends):
    while sum([await run(database, fleet_of, ends, robot) for robot in ROBOTS]):
        pass


def better(digest, ordinal):
    return digest == B


async def test_a_better_policy_is_found_after_eight_goals_and_both_jobs_end(database, fleet_of):
    asked = await submit(database, trials=40, question=QuestionRequest(against=A))
    states = [row.state for row in await rows(database, trial)]
    assert states == [TrialState.HELD] * 80  # nothing is queued before the judge lets it in
    await both_robots(database, fleet_of, better)
    twin, this = await rows(database)
    assert (this.job_id, this.state, twin.state) == (asked, "succeeded", "succeeded")
    assert this.seed == twin.seed and this.seed_drawn_by_server
    for each in (twin, this):
        assert each.counted_trials == 8 and each.trials_done <= 8 + len(ROBOTS)
    bodies = [read_report(row.body) for row in await rows(database, report)]
    assert [(body.trials, body.successes, body.intervals) for body in bodies] == [(8, 0, "sequence"), (8, 8, "sequence")]
    question = bodies[1].question
    assert (question.verdict, question.goals, question.gained, question.lost) == (Verdict.BETTER, 8, 8, 0)
    assert question == bodies[0].question and question.sentence.startswith("b is better than a, known after 8 goals")
    assert question.same_robot == 8
    assert {row.state for row in await rows(database, trial)} == {TrialState.DONE, TrialState.CANCELLED}
    assert await move(database) == []


async def test_no_more_goals_are_under_way_than_there_are_robots(database, fleet_of):
    await submit(database, trials=40, question=QuestionRequest(against=A))
    await move(database)
    queued = [row.trial_id[-3:] for row in await rows(database, trial) if row.state == TrialState.QUEUED]
    assert queued == ["000", "001"] * 2


async def test_a_job_is_compared_with_one_that_is_over_on_its_goals_and_robots(database, fleet_of):
    first = await submit(database, A, trials=12)
    await both_robots(database, fleet_of, lambda digest, ordinal: ordinal == 3)
    await submit(database, trials=40, question=QuestionRequest(against=first, at_least=0.2))
    done = [row for row in await rows(database, trial) if row.trial_id.startswith(first)]
    new = [row for row in await rows(database, trial) if not row.trial_id.startswith(first)]
    assert [row.seed for row in new] == [row.seed for row in done]
    assert [json.loads(row.robot_order)[0] for row in new] == [row.robot for row in done]
    await both_robots(database, fleet_of, better)
    other, this = await rows(database)
    assert (this.trials, this.counted_trials, this.seed_drawn_by_server) == (12, 9, False)
    assert (other.state, other.counted_trials) == ("succeeded", None)
    assert read_report((await rows(database, report))[1].body).question.same_robot == 9


async def test_equal_policies_stay_undecided_and_stop_when_nothing_can_be_decided_any_more(database, fleet_of):
    await submit(database, trials=20, question=QuestionRequest(against=A))
    await both_robots(database, fleet_of, lambda digest, ordinal: ordinal % 2 == 0)
    twin, this = await rows(database)
    assert (this.counted_trials, twin.counted_trials) == (13, 13)
    assert read_report((await rows(database, report))[1].body).question.verdict is Verdict.UNDECIDED


async def test_a_rate_above_a_bar_ends_the_job_and_boards_take_it_by_its_sequence(database, fleet_of):
    await submit(database, trials=40, question=QuestionRequest(bar=0.5))
    await both_robots(database, fleet_of, better)
    (this,) = await rows(database)
    assert this.state == "succeeded" and 5 <= this.counted_trials < 12
    async with database.read() as connection:
        (row,) = (await leaderboard.board(connection, Wanted(PUSH), None)).rows
    assert (row.trials, row.successes, row.intervals) == (this.counted_trials, this.counted_trials, "sequence")
    assert row.interval_80 == read_report((await rows(database, report))[0].body).interval_80


async def test_a_cancelled_job_takes_its_twin_with_it_and_is_not_queued_again(database, fleet_of):
    asked = await submit(database, trials=20, question=QuestionRequest(against=A))
    async with database.write() as tx:
        await cancellation.cancel(tx, 1000.0, 2)
    assert len(await move(database)) == 1
    twin, this = await rows(database)
    assert (twin.state, this.state, this.job_id) == ("cancelled", "cancelled", asked)
    assert {row.state for row in await rows(database, trial)} == {TrialState.CANCELLED}
    async with database.write() as tx:
        with pytest.raises(Conflict, match="only a failed job"):
            await requeue.requeue(tx, 1000.0, 2)


async def test_a_job_whose_other_ends_without_a_trial_fails_with_a_reason(database, fleet_of):
    first = await submit(database, A, trials=4)
    await submit(database, trials=4, question=QuestionRequest(against=first))
    async with database.write() as tx:
        await cancellation.cancel(tx, 1000.0, 1)
    await move(database)
    _, this = await rows(database)
    assert (this.state, this.reason) == ("failed", judging.NOTHING_TO_COMPARE)
    with pytest.raises(Conflict, match="cancelled without a trial"):
        await submit(database, trials=4, question=QuestionRequest(against=first))


async def test_jobs_of_others_and_of_other_tasks_are_no_goals(database, fleet_of):
    first = await submit(database, A, trials=4)
    async with database.write() as tx:
        with pytest.raises(NotFound, match=f"no job {first} of yours"):
            await goals.source(tx, JobRequest(policy=B, task=PUSH, like=first), "bob")
        wish = JobRequest(policy=B, task=TaskName.LIFT, like=first)
        with pytest.raises(Refused, match="has task push"):
            await submission.submit(tx, 1000.0, wish, Sender("ann"))
        with pytest.raises(Refused, match="not better than itself"):
            wish = JobRequest(policy=B, task=PUSH, question=QuestionRequest(against=B))
            await submission.submit(tx, 1000.0, wish, Sender("ann"))


async def test_a_job_like_one_that_was_stopped_has_the_goals_that_were_tried(database, fleet_of):
    first = await submit(database, question=QuestionRequest(bar=0.5))
    await both_robots(database, fleet_of, better)
    (this,) = await rows(database)
    await submit(database, A, like=first)
    assert (await rows(database))[1].trials == this.counted_trials < this.trials_done + 2 < this.trials
    stopped = await submit(database, A, trials=6)
    await run(database, fleet_of, better)
    third = [row for row in await rows(database, trial) if row.trial_id.startswith(stopped)]
    async with database.write() as tx:  # as if its second and its last two had never come to an end
        for each in third:
            state = TrialState.CANCELLED if each.ordinal in (1, 4, 5) else TrialState.DONE
            await tx.execute(update(trial).where(trial.c.trial_id == each.trial_id).values(state=state))
        await tx.execute(update(job).where(job.c.job_id == stopped).values(state="cancelled"))
    await submit(database, like=stopped)
    await submit(database, question=QuestionRequest(against=stopped))
    seeds = [[row.seed for row in await rows(database, trial) if row.job_number == number] for number in (3, 4, 5)]
    assert seeds[1] == [seeds[0][at] for at in (0, 2, 3)], "those that were done"
    assert seeds[2] == seeds[0][:1], "of a question those before the first that was not"


async def test_no_board_takes_a_job_whose_goals_its_user_could_have_known(database, fleet_of):
    own = await submit(database, A, goals=[{"position_m": [0.05, 0.0, 0.0325]}] * 8)
    fair = await submit(database, A, trials=8)
    await both_robots(database, fleet_of, better)
    unfair = [await submit(database, like=own), await submit(database, like=fair), await submit(database, seed=7, trials=8)]
    unfair.append(await submit(database, trials=8, question=QuestionRequest(against=fair)))
    await both_robots(database, fleet_of, better)
    assert {row.state for row in await rows(database)} == {"succeeded"} and len(unfair) == 4
    async with database.read() as connection:
        (row,) = (await leaderboard.board(connection, Wanted(PUSH), None)).rows
    assert (row.policy, row.jobs, row.trials) == (A, 1, 8)
    await submit(database, trials=40, question=QuestionRequest(against=A))  # the farm draws the goals of both
    await both_robots(database, fleet_of, better)
    async with database.read() as connection:
        shown = (await leaderboard.board(connection, Wanted(PUSH), None)).rows
    assert [(row.policy, row.jobs, row.letters) for row in shown] == [(B, 1, "a"), (A, 2, "b")]


async def test_own_goals_go_with_the_trials_and_to_no_board(database, fleet_of):
    brought = [{"position_m": [0.05, 0.0, 0.0325]}, {"position_m": [0.0, 0.1, 0.0325], "start": {"position_m": [0.0, 0.0]}}]
    first = await submit(database, A, goals=brought)
    await submit(database, like=first, trials=2)
    kept = [json.loads(row.own_goal)["position_m"] for row in await rows(database, trial)]
    assert kept == [goal["position_m"] for goal in brought] * 2
    seeds = [row.seed for row in await rows(database, trial)]
    assert seeds[:2] == seeds[2:] and len(set(seeds)) == 2
    await both_robots(database, fleet_of, better)
    async with database.read() as connection:
        assert (await leaderboard.board(connection, Wanted(PUSH), None)).rows == ()
    assert read_report((await rows(database, report))[0].body).own_goals
