"""The shipped policies are what their README and their records say."""

import json
import re
from pathlib import Path

import pytest
from safetensors.numpy import load_file

from api_schemas.policy import PolicyManifest
from sim_backend.training import reference_policies

FOLDER = Path(next(iter(reference_policies.__path__)))
README = (FOLDER / "README.md").read_text(encoding="utf-8")
NAMES = sorted(path.stem for path in FOLDER.glob("*.safetensors"))


def described(name: str) -> str:
    """What the README says about one policy."""
    return re.sub(r"\s+", " ", README.partition(f"**{name}.**")[2].partition("\n\n")[0])


def record(name: str) -> dict:
    return json.loads((FOLDER / f"{name}-record.json").read_text(encoding="utf-8"))


def test_there_is_a_policy():
    assert "push" in NAMES


def settings(name: str) -> dict:
    """What shaped a run; records of recipes keep networks and learning in tables of their own."""
    kept = record(name)["settings"]
    tables = (kept.get(table, {}) for table in ("student", "imitation", "networks", "ppo"))
    merged = {key: value for table in (kept, *tables) for key, value in table.items()}
    return {"hidden": merged.get("actor")} | merged


@pytest.mark.parametrize("name", NAMES)
def test_readme_and_record_give_the_layers_that_the_weights_have(name):
    weights = load_file(FOLDER / f"{name}.safetensors")
    layers = [
        weights[f"layer{index}.weight"] for index in range(sum(re.match("layer.*weight", key) is not None for key in weights))
    ]
    hidden = [layer.shape[0] for layer in layers[:-1]]
    said = re.search(r"hidden layers? of (\d+(?:(?:, | and )\d+)*)", described(name))
    assert said is not None
    assert [int(width) for width in re.findall(r"\d+", said[1])] == hidden
    assert settings(name)["hidden"] == hidden
    manifest = PolicyManifest.model_validate_json((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    inputs = manifest.observation_size
    if manifest.recurrent is not None:
        assert f"{manifest.recurrent.value.upper()} of {settings(name)['cells']} cells" in described(name)
        assert weights["recurrent.weight_ih_l0"].shape[1] == inputs
        inputs = settings(name)["cells"]
    sizes = [inputs, *hidden, 9]
    assert [layer.shape for layer in layers] == list(zip(sizes[1:], sizes[:-1], strict=True))
    assert [weights[f"layer{index}.bias"].shape for index in range(len(layers))] == [(size,) for size in sizes[1:]]


@pytest.mark.parametrize("name", NAMES)
def test_readme_and_record_give_the_same_training(name):
    kept, text = settings(name), described(name)
    assert f"drawn anew from the ranges `{kept['physics']}`" in text
    assert f"({1000 * kept['physics_step_s']:g} ms physics, {kept['robots']} robots" in text


def test_all_are_listed_with_what_their_records_say(capsys):
    from sim_backend.training.reference_policies.__main__ import listed, main

    assert [row["name"] for row in listed()] == NAMES == reference_policies.names()
    main()
    printed = capsys.readouterr().out
    for row in listed():
        assert Path(row["file"]).is_file() and row["name"] in printed
        assert all(f"{rate:.1%} on {physics} robots" in printed for physics, rate in row["success_rate"].items())
