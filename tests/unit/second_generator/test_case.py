"""Cases: what a stranger would bring, the same from the same seed, and nothing of the truth."""

import ast
import json
import tomllib
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests import ROOT
from tests.second_generator import case as cases
from tests.second_generator import causes, outside
from tests.second_generator.__main__ import main
from tests.second_generator.arms import draw_arm, shaken
from tests.second_generator.folder import name_of, truth_of, write_case
from tests.second_generator.plant import smallest_inertia
from tests.second_generator.seeds import DEVELOPMENT_SEEDS, FINAL_COUNTS, FINAL_SEEDS, KINDS
from tests.unit.second_generator.arms import PENDULUM, body_of

SEED = 11


@pytest.fixture(scope="module")
def draw():
    """``draw_case`` with recordings of 2 s instead of 10 to 40. The cases that are drawn here have one joint."""
    whole = cases.draw_session

    def draw_session(rng, arm, names):
        session = whole(rng, arm, names)
        return replace(session, seconds=tuple(2.0 for _ in session.seconds))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cases, "draw_session", draw_session)
        yield cases.draw_case


@pytest.fixture(scope="module")
def healthy(draw):
    return draw(SEED, "healthy", 37)


def files_below(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_the_same_case_is_the_same_to_the_last_byte_and_another_is_not(draw, healthy, tmp_path):
    for name, case in (("one", healthy), ("two", draw(SEED, "healthy", 37)), ("three", draw(SEED, "healthy", 12))):
        write_case(case, tmp_path / name)
    assert files_below(tmp_path / "one") == files_below(tmp_path / "two")
    assert set(files_below(tmp_path / "one")).isdisjoint(files_below(tmp_path / "three"))


def test_a_case_has_what_a_stranger_brings_and_no_truth(draw, tmp_path):
    case = draw(SEED, "single", 15)
    folder = tmp_path / "cases" / write_case(case, tmp_path)
    names = [path.name for path in folder.iterdir()]
    assert sorted(names) == ["recordings", "robot.xml", "study.toml"]
    study = tomllib.loads((folder / "study.toml").read_text())
    assert (folder / study["model"]).is_file()
    assert all((folder / recording["file"]).is_file() for recording in study["recording"])
    assert set(study["joints"]) == set(case.declared.names)
    said = (folder / "study.toml").read_text() + folder.name
    for word in (*causes.CATALOGUE, *outside.OUTSIDE, *KINDS):
        assert word not in said
    truth = json.loads((tmp_path / "truth" / f"{folder.name}.json").read_text())
    assert [cause["effect"] for cause in truth["causes"]] == list(cases.names_of(SEED, "single", 15))


def test_what_is_declared_is_the_arm_without_its_errors(healthy, tmp_path):
    case = healthy
    folder = tmp_path / "cases" / write_case(case, tmp_path)
    assert (folder / "robot.xml").read_text() == case.declared.mjcf()
    model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    assert model.body_mass[1:] == pytest.approx([link.mass_kg for link in case.declared.links])
    assert model.nu == case.declared.joints


def test_healthy_arms_are_about_a_hundredth_off():
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        declared = draw_arm(rng, 3)
        there = shaken(rng, declared)
        for a, b in zip(declared.links, there.links, strict=True):
            off += [b.mass_kg / a.mass_kg, b.inertia_kg_m2[0] / a.inertia_kg_m2[0], b.com_m[2] / a.com_m[2]]
            off += [b.armature_kg_m2 / a.armature_kg_m2, b.frictionloss_nm / a.frictionloss_nm]
            off.append(b.damping_nm_s_rad / a.damping_nm_s_rad)
        mujoco.MjModel.from_xml_string(there.mjcf())
    assert 0.008 < np.std(off) < 0.012
    assert abs(np.mean(off) - 1) < 0.003
    assert max(abs(np.array(off) - 1)) < 0.026


def seen_of(arm, rate_hz=500.0):
    one = np.ones(arm.joints)
    return causes.Seen(one, 3 * one, one, 0 * one, 0.5 * one, smallest_inertia(arm, {}), rate_hz)


@pytest.mark.parametrize("name", [*causes.CATALOGUE, *outside.OUTSIDE])
def test_every_cause_changes_how_an_arm_is_and_says_how_much(name):
    arm = draw_arm(np.random.default_rng(3), 2)
    arm = replace(arm, links=tuple(replace(link, frictionloss_nm=2.0) for link in arm.links))
    laws = causes.CATALOGUE | outside.OUTSIDE
    small, large = body_of(arm), body_of(arm)
    told = [laws[name](body, 1, seen_of(arm), size, np.random.default_rng(9)) for body, size in ((small, 0.1), (large, 0.9))]
    assert told[0] != told[1]
    assert repr(small) != repr(body_of(arm))


def test_every_cause_of_the_catalogue_is_documented_with_its_parameters_and_those_outside_are_not():
    documented = (ROOT / "docs/effects.md").read_text()
    arm = draw_arm(np.random.default_rng(3), 2)
    for name, law in causes.CATALOGUE.items():
        for parameter in law(body_of(arm), 1, seen_of(arm), 0.5, np.random.default_rng(9)):
            assert f"`{name}.{parameter}`" in documented
    for name in outside.OUTSIDE:
        assert f"`{name}." not in documented


def test_every_cause_comes_once_before_any_comes_twice():
    for kind, names in (("single", causes.CATALOGUE), ("outside", outside.OUTSIDE)):
        drawn = [cases.names_of(SEED, kind, index)[0] for index in range(2 * len(names))]
        assert sorted(drawn[: len(names)]) == sorted(drawn[len(names) :]) == sorted(names)
    for index in range(42):
        first, second = cases.names_of(SEED, "double", index)
        assert first != second


def test_a_large_cause_is_seen_better_than_a_small_one_and_both_are_written_down(healthy):
    case = healthy
    hidden = [cases.Cause("viscous_friction", False, (0,), size, 1) for size in (0.0, 1.0)]
    seen = []
    for cause in hidden:
        body, _ = cases.build(case.true, case.sensors, (cause,), case.seen)
        trace = cases.record(case.declared, body, case.sensors, case.session, 0, np.random.default_rng(1))
        seen.append(cases.visible(case, (cause,), (trace,), 0))
    assert 0 < 3 * seen[0] < seen[1]
    told = truth_of(replace(case, causes=(replace(hidden[1], visibility=seen[1]),)))["causes"][0]
    assert told["visibility"] == round(seen[1], 3)
    assert told["places"][0]["declared"] == case.declared.links[0].damping_nm_s_rad


def test_a_window_without_any_cause_repeats_the_recording(healthy):
    case = healthy
    body, _ = cases.build(case.true, case.sensors, (), case.seen)
    trace = cases.record(case.declared, body, case.sensors, case.session, 0, np.random.default_rng(1))
    nothing = cases.Cause("viscous_friction", False, (), 0.0, 1)
    assert cases.visible(case, (nothing,), (trace,), 0) == pytest.approx(0.0, abs=1e-9)


def test_final_seeds_are_sealed(tmp_path, capsys):
    assert not set(FINAL_SEEDS) & set(DEVELOPMENT_SEEDS)
    for seed in FINAL_SEEDS:
        assert main(["make", "--seed", str(seed), "--kind", "healthy", "--count", "1", "--to", str(tmp_path)]) == 2
    assert "sealed" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert sum(FINAL_COUNTS.values()) == 260


def test_names_of_cases_tell_nothing_and_differ():
    names = [name_of(seed, kind, index) for seed in (11, 12) for kind in KINDS for index in range(60)]
    assert len(set(names)) == len(names)


def test_the_generator_shares_no_code_with_the_tool():
    imported = set()
    for path in (ROOT / "tests/second_generator").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0
                imported.add(node.module)
    own = {name for name in imported if name.startswith("tests")}
    assert all(name.startswith("tests.second_generator") for name in own)
    assert not {name.partition(".")[0] for name in imported} & {
        *("sim_backend", "trifarm", "robot_farm", "services", "client_cli", "api_schemas", "trial_logs", "report_views"),
        *("experiments", "chaos", "importlib"),
    }


def test_a_tilt_is_a_gravity_that_turned():
    body = body_of(PENDULUM)
    told = causes.table_tilt(body, 0, seen_of(PENDULUM), 0.5, np.random.default_rng(0))
    x, y, z = body.arm.gravity_m_s2
    assert np.hypot(x, z) == pytest.approx(9.81)
    assert y == 0.0
    assert np.arctan2(-x, -z) == pytest.approx(-told["pitch_rad"])
