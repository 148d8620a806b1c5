"""What a recipe says otherwise than the settings of a run: every entry that matters, and no folder of a machine."""

import pytest

from sim_backend.training.changes import MAY_CHANGE, changes
from sim_backend.training.recipe import Recipe

BASE = {"task": "push", "layout": "push", "samples": 1000, "reward": {"approach": 1000.0}}


def settings(**more) -> dict:
    return Recipe.model_validate(BASE | more).model_dump(mode="json")


@pytest.mark.parametrize(
    ("more", "found"),
    [
        ({}, []),
        ({"seed": 2}, ["seed was 2 and is 1"]),
        ({"reward": {"approach": 5.0}}, ["reward.approach was 5.0 and is 1000.0"]),
        ({"networks": {"actor": [8]}}, ["networks.actor was [8] and is [128, 128]"]),
        ({"warm_start": {"policy": "push"}}, ["warm_start was {"]),
        (
            {"physics": "real", "about": "other words"},
            ["about was 'other words' and is ''", "physics was 'real' and is 'nominal'"],
        ),
    ],
)
def test_each_entry_is_named_with_both_values(more, found):
    said = changes(settings(**more), Recipe.model_validate(BASE))
    assert len(said) == len(found)
    assert all(any(each.startswith(wanted) for each in said) for wanted in found)


def test_what_may_change_is_left_out():
    before = settings(samples=2, about="x", minutes=3.0, checkpoint_minutes=1.0, evaluation={"trials": 3})
    assert changes(before, Recipe.model_validate(BASE), MAY_CHANGE) == []
    assert len(changes(before, Recipe.model_validate(BASE))) == 5


def test_where_a_file_lies_says_nothing_but_its_name_does():
    recipe = Recipe.model_validate(BASE | {"warm_start": {"run": "/here/starts/begun-1"}, "physics": "/here/a.toml"})
    assert changes(settings(warm_start={"run": "begun-1"}, physics="/there/a.toml"), recipe) == []
    assert changes(settings(warm_start={"run": "/here/starts/begun-2"}, physics="a.toml"), recipe) == [
        "warm_start.run was 'begun-2' and is 'begun-1'"
    ]


def test_an_entry_that_older_settings_lack_counts_where_the_recipe_names_it():
    before = settings()
    del before["physics_backend"], before["reward"]["approach"]
    assert changes(before, Recipe.model_validate(BASE)) == ["reward.approach was not there and is 1000.0"]
