"""Contrasts read both sides from what is kept, and note what a reader has to know."""

import math
from dataclasses import replace

import pytest

from experiments.catalogue import CATALOGUE
from experiments.contrasts import SMALLER, demonstrated_periods
from experiments.design import Demonstrations, Farm
from experiments.findings import findings
from experiments.judging import Arrival, Difference, Verdict
from experiments.page import experiment_page, overview
from experiments.power import Design, power
from experiments.result_files import Key
from experiments.run import document
from tests.unit.experiments.small import SMALL, TRIALS, complete, rows, store_of, train


def difference(judged) -> Difference:
    assert judged.found is not None
    return judged.found


def test_a_floor_leaves_it_undecided_and_says_why(tmp_path):
    (judged,) = findings(SMALL, complete(tmp_path, first=0, other=0)).judged
    assert judged.verdict is Verdict.UNDECIDED and judged.note == "too few successes to tell"


@pytest.mark.parametrize(("first", "other", "note"), [(0, 4, ""), (2, 3, SMALLER)])
def test_a_gain_that_is_there_but_smaller_than_of_interest_says_so(tmp_path, first, other, note):
    wanting = replace(SMALL, contrasts=(replace(SMALL.contrasts[0], interest=0.55),))
    (judged,) = findings(wanting, complete(tmp_path, first, other)).judged
    assert judged.verdict is Verdict.REPRODUCED and judged.note == note


def test_seeds_that_share_a_start_are_continuations_of_one_training(tmp_path):
    experiment = CATALOGUE["randomization"]
    store = store_of(tmp_path, experiment)
    for cell, reached in (("nominal", 3), ("randomized", 8)):
        for seed in (1, 2, 3):
            for block in range(4):
                store.keep_block(Key(cell, seed, "real"), block, rows(block, reached, 10), {})
    first = findings(experiment, store).judged[0]
    assert first.verdict is Verdict.REPRODUCED and first.note == "3 continuations of one training"


def of_one_robot(block: int, reached: int) -> list[dict]:
    """Rows on four robots, of which the first reaches its goals first."""
    return [{"goal": 16 * block + at, "robot": f"robot-{at // 4}", "reached": at < reached} for at in range(16)]


def keep_on_four_robots(tmp_path, physics):
    farm = replace(TRIALS, farms=(Farm(physics),), block=16)
    experiment = replace(SMALL, contrasts=(replace(SMALL.contrasts[0], farm=physics),), trials=farm)
    store = store_of(tmp_path, experiment)
    for cell, reached in zip(experiment.cells, (0, 4), strict=True):
        for seed in cell.seeds:
            for block in range(farm.blocks):
                store.keep_block(Key(cell.name, seed, physics), block, of_one_robot(block, reached), {})
    return findings(experiment, store)


def test_a_gain_on_one_of_four_robots_that_differ_is_undecided_and_the_page_says_why(tmp_path):
    found = keep_on_four_robots(tmp_path, "real")
    (judged,) = found.judged
    assert judged.verdict is Verdict.UNDECIDED and difference(judged).robots == 4
    page = experiment_page(found, figure=False)
    assert "N = 64 pairs, 2 runs, on 4 robots | robots |" in page and "since both sides share the farm's few robots" in page
    assert document(found)["contrasts"][0]["found"]["widest"] == ("robots", "robots")
    assert document(found)["cells"][1]["interval_80"][0] == 0.0, "the rate of a cell holds what robots differ by, too"


def test_nominal_robots_are_alike_and_no_chance(tmp_path):
    found = keep_on_four_robots(tmp_path, "nominal")
    (judged,) = found.judged
    assert judged.verdict is Verdict.REPRODUCED and difference(judged).robots == 0
    assert "N = 64 pairs, 2 runs |" in experiment_page(found, figure=False)


def test_pairs_that_two_robots_tried_are_counted_in_the_note(tmp_path):
    store = complete(tmp_path)
    path = store.folder / "trials" / "other-seed2-real.json"
    path.write_text(path.read_text().replace("robot-0", "robot-1", 3))
    (judged,) = findings(SMALL, store).judged
    assert judged.note == "3 of 20 pairs on two robots"


def test_a_demonstration_is_a_whole_trial_of_its_task_at_the_rate_of_its_policy():
    assert demonstrated_periods(None) == 0
    assert demonstrated_periods(Demonstrations("push-scratch", "push", 25)) == 25 * 15 * 50
    assert demonstrated_periods(Demonstrations("push-scratch", "lift", 1)) == 30 * 50


def keep_demonstrations(tmp_path, of_none, of_25, of_100):
    """Runs of (c) with these evaluations; a rate at 0 samples is that of the clone."""
    experiment = CATALOGUE["demonstrations"]
    store = store_of(tmp_path, experiment)
    for cell, rates in zip(experiment.cells, (of_none, of_25, of_100), strict=True):
        for seed in cell.seeds:
            train(store, cell, seed, samples=1_200_000)
            kept = store.run(cell, seed)
            assert kept is not None
            kept["evaluations"] = [
                {"samples": at, "physics": "nominal", "success_rate": rate, "trials": 64} for at, rate in rates.items()
            ]
            store.files.write(store.folder / "runs" / f"{Key(cell.name, seed).stem}.json", "run", kept)
    return findings(experiment, store)


def test_demonstrated_samples_count_in_what_demonstrations_save(tmp_path):
    found = keep_demonstrations(
        tmp_path, {600_000: 0.3, 1_200_000: 0.9}, {0: 0.9, 100_000: 0.9}, {0: 0.3, 100_000: 0.5, 200_000: 0.9}
    )
    assert found.arrivals["demonstrations-25"] == [(seed, Arrival(18_750, 18_750)) for seed in (1, 2, 3)]
    assert found.arrivals["demonstrations-100"] == [(seed, Arrival(175_000, 275_000)) for seed in (1, 2, 3)]
    of_25, of_100, between = found.judged
    assert difference(of_25).estimate == pytest.approx(math.log2(1_200_000 / 18_750))
    assert difference(of_25).low == pytest.approx(math.log2(600_000 / 18_750)) and of_25.verdict is Verdict.REPRODUCED
    assert difference(of_100).low == pytest.approx(math.log2(600_000 / 275_000))
    assert between.contrast.ours and between.verdict is Verdict.NOT_FOUND
    page = experiment_page(found, figure=True)
    assert "| `demonstrations-25` | 1 | 18,750 | there before PPO | 90% of 64 | 90% of 64 |" in page
    assert of_25.note == "3 of 3 runs of demonstrations-25 were there before any PPO, by cloning alone" and not of_100.note
    assert "| `demonstrations-100` | 3 | 275,000 | 175,000 | 30% of 64 | 90% of 64 |" in page
    assert "times fewer, 3 runs each" in page
    of_first = {"cell": "demonstrations-0", "seed": 1, "success_rate": 0.8, "after": 600_000, "by": 1_200_000}
    assert document(found)["samples_to"][0] == of_first


def test_a_run_that_never_arrives_leaves_the_saving_open_above(tmp_path):
    found = keep_demonstrations(tmp_path, {600_000: 0.3, 1_200_000: 0.5}, {0: 0.9}, {0: 0.3, 1_200_000: 0.5})
    of_25, of_100, between = found.judged
    assert difference(of_25).high == math.inf and of_25.verdict is Verdict.REPRODUCED
    cloned = "3 of 3 runs of demonstrations-25 were there before any PPO, by cloning alone"
    assert of_25.note == f"3 of 3 runs of demonstrations-0 never arrived; {cloned}"
    assert of_100.verdict is Verdict.UNDECIDED and difference(of_100).low == -math.inf
    assert between.verdict is Verdict.NOT_FOUND
    page = experiment_page(found, figure=True)
    assert "to +∞)" in page
    assert page.count("| no estimate, 3 runs each |") == 1


def test_what_two_clones_differ_by_is_told_as_a_constant_of_the_design(tmp_path):
    found = keep_demonstrations(tmp_path, {1_200_000: 0.5}, {0: 0.9}, {0: 0.9})
    between = found.judged[2]
    assert difference(between).width == 0.0
    assert between.note.endswith("a constant of the design: only numbers of demonstrations are compared")
    assert "constant" not in found.judged[0].note


def test_what_was_known_before_is_marked_and_is_no_test(tmp_path):
    known = replace(SMALL, contrasts=(replace(SMALL.contrasts[0], known_from="(a)"),))
    found = findings(known, complete(tmp_path))
    assert found.judged[0].note == "known from (a)" and "reproduced (known from (a)) |" in experiment_page(found, figure=True)
    text = overview([found])
    assert "The answers of 1 of them were known from an earlier experiment when they were written down (1 reproduced" in text
    assert "were known" not in overview([findings(SMALL, complete(tmp_path))])


def test_what_stays_undecided_is_told_with_the_power_that_its_own_trials_give(tmp_path):
    store = store_of(tmp_path)
    for cell, reached in zip(SMALL.cells, ((2, 2), (4, 1)), strict=True):
        for seed, each in zip(cell.seeds, reached, strict=True):
            train(store, cell, seed)
            for block in range(2):
                store.keep_block(Key(cell.name, seed, "real"), block, rows(block, each), {"task": "push"})
    found = findings(SMALL, store)
    (judged,) = found.judged
    assert judged.verdict is Verdict.UNDECIDED and judged.observed is not None
    assert judged.observed.first == 0.4 and judged.observed.changing == pytest.approx(0.3)
    of_differences, chance = 0.6 / 2**0.5, ((0.4 - 0.16) / 9 + (0.2 - 0.04) / 9) / 2
    assert judged.observed.spread == pytest.approx((of_differences**2 - chance) ** 0.5)
    expected = power(Design(2, 10, 0.2, robots=1, first=0.4, changing=judged.observed.changing), 0.2, judged.observed.spread)
    page = experiment_page(found, figure=True)
    assert f"undecided (power {expected:.0%} to tell a gain of 0.2, trainings spread by 0.40 and 30% of the goals" in page


def test_runs_that_never_arrive_on_either_side_tell_no_saving(tmp_path):
    found = keep_demonstrations(tmp_path, {1_200_000: 0.5}, {1_200_000: 0.7}, {1_200_000: 0.7})
    assert all(each.verdict is Verdict.UNDECIDED for each in found.judged)
    page = experiment_page(found, figure=True)
    assert page.count("| no estimate, 3 runs each |") == 3
    assert "times fewer" not in page
    assert document(found)["contrasts"][0]["found"]["high"] is None
    assert document(found)["samples_to"][0]["by"] is None


def keep_goals(tmp_path, nominal, real):
    many = CATALOGUE["consecutive"]
    store = store_of(tmp_path, many)
    for physics, reached in (("nominal", nominal), ("real", real)):
        store.keep_measured(Key("push", 1, physics), {"reached": reached, "ended": ["time"] * len(reached)})
    return findings(many, store)


def test_nominal_and_real_trials_of_the_same_seeds_are_paired(tmp_path):
    found = keep_goals(tmp_path, [20, 40, 9, 31, 25], [12, 33, 2, 22, 18])
    judged = found.judged[0]
    assert difference(judged).n == 5 and difference(judged).estimate == pytest.approx(7.6)
    assert judged.verdict is Verdict.FOUND, "unpaired the trials would spread too far"
    assert "| `push` | nominal | 25.0 ± 11.6 | 25 | 40 31 25 20 9 | time 5 |" in experiment_page(found, figure=True)


def test_goals_at_the_cap_tell_nothing(tmp_path):
    judged = keep_goals(tmp_path, [50] * 20, [50] * 20).judged[0]
    assert judged.verdict is Verdict.UNDECIDED
    assert judged.note.startswith("too many goals to tell; all 50 goals: 20 of 20 trials on varied simulated robots")


def test_what_a_memory_knows_is_noted_with_how_often_the_side_is_told(tmp_path):
    memory = CATALOGUE["memory"]
    assert memory.hidden is not None
    store = store_of(tmp_path, memory)
    known = {"at_s": 5.0, "of_state": 0.5, "of_observation": 0.1, "difference": 0.4, "low": 0.3, "high": 0.5, "robots": 300}
    told = known | {"of_both": 0.5, "told_by_state": 0.8, "told_by_observation": 0.55}
    for seed in (1, 2, 3):
        parameters = {name: [told if name.startswith("cube") else known] for name in memory.hidden.parameters}
        store.keep_measured(Key("lstm", seed, "real"), {"parameters": parameters})
    found = findings(memory, store)
    by_name = {each.contrast.name: each for each in found.judged}
    assert by_name["memory against none, varied simulated robots"].verdict is Verdict.NOT_RUN
    cube, table = by_name["cube size, known beyond what is seen"], by_name["table friction, known beyond what is seen"]
    assert cube.verdict is table.verdict is Verdict.REPRODUCED
    assert cube.note == "after 5 s; whether above the mean told rightly of 80% of the robots"
    assert table.note == "after 5 s", "results of before this was asked stay readable"
    assert "80% (77% to 83%) |" in experiment_page(found, figure=True)
