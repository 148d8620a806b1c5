"""Entries of a board: recipes of several seeds, pairs on common goals, letters with the chance of any false one kept."""

from types import SimpleNamespace

import numpy as np
import pytest
from sqlalchemy import update

from api_schemas.job import JobRequest, TaskName
from services.database.tables import job
from services.jobs import leaderboard, submission
from services.jobs.leaderboard import Wanted
from services.jobs.standings import Entry, Tried, entries, letters_of, pairs_of
from services.jobs.submission import Sender
from tests.unit.services.jobs import test_ladders
from tests.unit.services.jobs.test_ladders import A, B, C

database = test_ladders.database


def row(policy, successes, trials, recipe=None, owner=None, judged=0):
    made = {"policy": policy, "successes": successes, "trials": trials, "recipe": recipe, "recipe_owner": owner}
    return SimpleNamespace(**made, judged=judged, jobs=1, name=policy, owner="ann", last="now")


def test_a_recipe_of_several_policies_is_one_entry_with_an_interval_over_them():
    found = entries([row("a", 38, 40, "r", "ann"), row("b", 10, 40, "r", "ann"), row("c", 30, 40), row("d", 9, 40, "r", "bob")])
    recipe = next(each for each in found if each.recipe == "r")
    assert sorted(len(each.rows) for each in found) == [1, 1, 2], "one of the same name is another user's"
    assert recipe.rate == pytest.approx(0.6)
    low, high = recipe.interval(0.80)
    alone = Entry([row("x", 48, 80)]).interval(0.80)
    assert low < alone[0] - 0.1 and high > alone[1] + 0.1


def test_a_policy_of_a_recipe_of_one_is_pooled_with_what_was_sent_without_it():
    (found,) = entries([row("a", 3, 4, "r", "ann"), row("a", 1, 4)])
    assert (found.successes, found.trials, found.recipe) == (4, 8, None)


def test_goals_in_common_are_paired_and_the_rest_in_its_order():
    one, other = Tried({7: "11", 1: "1100"}), Tried({2: "000", 7: "01", 3: "1"})
    assert pairs_of(one, other) == (1 + 2, 0 + 1)


def test_ten_equal_policies_are_seldom_told_apart_however_often_one_looks():
    """A look after each job of each policy, some with goals in common."""
    rng, runs, wrong = np.random.default_rng(7), 60, 0
    for _ in range(runs):
        tried = {f"p{at}": Tried() for at in range(10)}
        for look in range(6):
            hard = rng.normal(size=10)
            for at, each in enumerate(tried.values()):
                common = at < 4
                outcomes = (rng.normal(size=10) > (hard if common else rng.normal(size=10))).astype(int)
                each.add(look if common else 1000 * at + look, "".join(map(str, outcomes)))
            ranked = [Entry([row(name, 1, 2)]) for name in tried]
            if set(letters_of(ranked, tried)) != {"a"}:
                wrong += 1
                break
    assert wrong / runs <= 0.05


async def sent(database, digest, outcomes, owner="ann", **more):
    async with database.write() as tx:
        wish = JobRequest(policy=digest, task=TaskName.PUSH, trials=len(outcomes), **more)
        job_id, _ = await submission.submit(tx, 1000.0, wish, Sender(owner))
        counts = {"trials_done": len(outcomes), "successes": outcomes.count("1"), "outcomes": outcomes, "state": "succeeded"}
        await tx.execute(update(job).where(job.c.job_id == job_id).values(counts | {"ended_at": f"{job_id}"}))


async def test_seeds_of_a_recipe_stand_as_one_entry_whose_name_only_its_owner_sees(database):
    for seed, (digest, good) in enumerate(((A, 38), (B, 30))):
        await sent(database, digest, "1" * good + "0" * (40 - good), recipe="ours", training_seed=seed)
    await sent(database, C, "0" * 36 + "1" * 4)
    await sent(database, A, "1" * 40)
    boards = {}
    async with database.read() as connection:
        for sees_only in (None, "bob"):
            boards[sees_only] = (await leaderboard.board(connection, Wanted(TaskName.PUSH), sees_only)).rows
    first = {(each.recipe, each.policy): each for each in boards[None]}
    recipe = first["ours", None]
    assert (recipe.training_seeds, recipe.trials, recipe.intervals, recipe.success_rate) == (2, 80, "seeds", 0.85)
    assert first[None, A].trials == 40, "what was sent without the recipe is the policy's own"
    assert first[None, A].letters != first[None, C].letters
    hidden = next(each for each in boards["bob"] if each.training_seeds)
    assert (hidden.recipe, hidden.owner, hidden.policy, hidden.policy_name) == (None, None, None, None)


def test_a_recipe_needs_its_seed():
    with pytest.raises(ValueError, match="go together"):
        JobRequest(policy=A, task=TaskName.PUSH, recipe="ours")
