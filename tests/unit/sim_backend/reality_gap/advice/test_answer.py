"""What to record next: from verdicts to excitations, checked against the physics that the advice rests on."""

import json
import shlex

import numpy as np
import pytest

from api_schemas.excitation import IdentificationRequest
from sim_backend.driver.driver import Command
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.physics import Physics
from sim_backend.excitations.excitation import EXCITATIONS, RAISED_RAD
from sim_backend.reality_gap.advice.advice import advice_after, first_advice
from sim_backend.reality_gap.advice.answer import main, read_study
from sim_backend.reality_gap.advice.course import WAY_UP_S, targets
from sim_backend.reality_gap.knowledge.excitations import BY_HAND, FOLLOWED, SHOWN_BY
from sim_backend.reality_gap.knowledge.separation import SEPARATIONS
from sim_backend.reality_gap.report.report import write_html
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import VARIABLES
from sim_backend.reality_gap.verdict import Cause, Rival, Verdict, VerdictKind
from sim_backend.tasks.task import draw_start
from sim_backend.trifinger import constants as c

JOINT = c.JOINT_NAMES[4]
ARM = """
<mujoco><worldbody><body><joint name="turn" range="-60 100"/><geom size="0.1"/>
<body pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody></mujoco>
"""


def cause(effect, where=JOINT):
    parameter = CATALOGUE[effect].parameters[0]
    return Cause(effect, parameter.name, where, 0.1, parameter.unit, (0.0, 0.2))


def verdict(kind, *causes, **others):
    return Verdict(VerdictKind(kind), "summary", tuple(causes), **others).document()


def study(folder, kind="confusable", causes=("coulomb_friction", "stribeck_friction"), **others):
    document = {"format": 1, "title": "a study", "verdict": verdict(kind, *map(cause, causes), **others)}
    (folder / "study.json").write_text(json.dumps(document))
    return document


def names(advice):
    return [advised.name for advised in advice.excitations]


def printed(capsys, *arguments):
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_data_that_are_not_as_they_are_told_are_checked_before_anything_is_recorded():
    check = "nothing yet: check position_unit of elbow in study.toml and in whatever wrote the data"
    misread = verdict("unexplained", misreads="the positions of elbow are in degrees", record_next=(check,))
    advice = advice_after(misread)
    assert "check that before" in advice.why and (advice.excitations, advice.said_by_study) == ((), (check,))


def test_one_cause_beside_what_is_none_is_recorded_again():
    advice = advice_after(verdict("confusable", cause("coulomb_friction")))
    assert advice.why.endswith("record what tells coulomb friction from what looks like it.")
    assert names(advice) == [SHOWN_BY["coulomb_friction"][0]]


def test_every_effect_is_shown_by_an_excitation_or_by_hand():
    assert set(CATALOGUE) == set(SHOWN_BY) | set(BY_HAND)
    assert {name for shown in SHOWN_BY.values() for name in shown} <= set(EXCITATIONS)
    assert all(pair <= set(CATALOGUE) for pair in SEPARATIONS)
    for distinction in SEPARATIONS.values():
        assert set(distinction.excitations) <= set(EXCITATIONS)
        assert 1 <= distinction.needs <= len(distinction.excitations)


def test_whatever_a_residual_can_follow_is_known():
    assert set(VARIABLES) == set(FOLLOWED)
    for variable in VARIABLES:
        advice = advice_after(verdict("unexplained", follows=(f"{variable} of {JOINT} (mechanics equation, 80 nats)",)))
        assert set(names(advice)) == set(FOLLOWED[variable][1])
        assert f"follows {variable}:" in advice.excitations[0].why


@pytest.mark.parametrize("pair", SEPARATIONS, ids=lambda pair: " and ".join(sorted(pair)))
def test_a_confusable_pair_gets_what_separates_it(pair):
    first, second = sorted(pair)
    advice = advice_after(verdict("confusable", cause(first), cause(second)))
    chosen, known = names(advice), SEPARATIONS[pair]
    assert chosen[0] == known.excitations[0]
    assert len(set(chosen) & set(known.excitations)) == len(chosen) == known.needs
    assert advice.excitations[0].separates == ((first, second, known.by),)
    assert known.by in advice.excitations[0].why


def test_what_settles_most_comes_first():
    advice = advice_after(verdict("confusable", *map(cause, ("encoder_offset", "gravity", "action_delay", "viscous_friction"))))
    assert names(advice)[0] == "joint_limits"  # three of six pairs at once
    assert len(names(advice)) == len(set(names(advice)))


def test_one_effect_at_several_joints_is_told_by_joints_that_move_one_by_one():
    axes = [cause("tracking_offset", axis) for axis in "xyz"]
    assert "chirps" not in names(advice_after(verdict("confusable", *axes, cause("cube_size", "cube")))), "axes are no joints"
    advice = advice_after(verdict("confusable", cause("backlash", JOINT), cause("backlash", c.JOINT_NAMES[5])))
    assert names(advice) == ["chirps"]


def test_a_named_cause_is_held_to_other_motions_and_to_its_rival():
    rival = Rival("viscous_friction", JOINT, 9.0, "slow and fast")
    advice = advice_after(verdict("named", cause("coulomb_friction"), runner_up=rival), recorded=("fast_sweeps",))
    assert set(names(advice)) == {"fast_sweeps", "slow_ramps"}
    advice = advice_after(verdict("named", cause("coulomb_friction")), recorded=("fast_sweeps",))
    assert names(advice) == ["slow_ramps"]


def test_after_nothing_wrong_only_the_unseen_is_advised():
    advice = advice_after(verdict("nothing_wrong"), recorded=[name for name in EXCITATIONS if name != "chirps"])
    assert names(advice) == ["chirps"]


def test_a_robot_at_rest_and_an_unknown_robot_get_the_same_session():
    resting = advice_after(verdict("not_identifiable", record_next=("move it",)))
    assert names(resting) == names(first_advice()) == ["standard", "slide_cube"]
    assert resting.said_by_study == ("move it",)


def test_what_no_excitation_gives_is_said():
    advice = advice_after(verdict("confusable", cause("torque_constant"), cause("link_mass")))
    assert advice.by_hand == (BY_HAND["torque_constant"],)


def test_the_advised_excitation_separates_better_than_another_one():
    """Joints at their ends tell an encoder from a tilt, poses in the air do not."""
    tilt, offset = ("table_tilt.roll_rad", 0.01), ("encoder_offset.offset_rad", 0.01)
    physics = Physics.stack([Physics.nominal(), *(Physics.of(1, {key: value}) for key, value in (tilt, offset))])
    (best,) = names(advice_after(verdict("confusable", cause("encoder_offset"), cause("table_tilt"))))
    assert _apart(best, physics) > 2.0 * _apart("hold_poses", physics)


def _apart(name, physics):
    """Of two changes, the smaller one's part that is not parallel to the larger one: standard deviations a sample."""
    table = targets(name, np.random.default_rng(0))
    start, driver = draw_start(np.random.default_rng(3)), SimulatedDriver(robots=physics.n, physics=physics)
    far = np.array([[0.0, 0.0, 1e5]])  # contacts of the cube would take most of the time
    fields = (start.joint_position_rad, far, start.cube_quat_wxyz)
    driver.reset(type(start)(*(np.repeat(field, physics.n, axis=0) for field in fields)))
    pushes = np.zeros_like(table.position_rad) if table.torque_nm is None else table.torque_nm
    commands = [_command(position, push, physics.n) for position, push in zip(table.position_rad, pushes, strict=True)]
    segment = driver.advance([(command, 10) for command in commands])
    seen = np.concatenate([segment.joint_position_rad / 1e-3, segment.measured_torque_nm / 5e-3], axis=2)[:, ::10]
    first, second = (seen[1:] - seen[:1]).reshape(2, -1) / np.sqrt(seen.shape[1])
    small, large = sorted((first, second), key=np.linalg.norm)
    return np.linalg.norm(small - large * (small @ large) / (large @ large))


def _command(position, push, n):
    return Command(np.tile(push, (n, 1)), np.tile(position, (n, 1)))


@pytest.mark.parametrize("kind", VerdictKind)
def test_the_command_is_one_that_trifarm_takes(tmp_path, capsys, kind):
    study(tmp_path, kind, runner_up=Rival("viscous_friction", JOINT, 1.0, ""))
    said = printed(capsys, tmp_path, "--robot", "robot-2")
    words = shlex.split(said["command"])
    assert words[:2] == ["trifarm", "identify"]
    given = dict.fromkeys(words[2::2])
    assert set(given) == {"--robot", "--excitation", "--repeats", "--to"}
    options = list(zip(words[2::2], words[3::2], strict=True))
    chosen = tuple(value for flag, value in options if flag == "--excitation")
    request = IdentificationRequest.model_validate(
        {"robot": dict(options)["--robot"], "excitations": chosen, "repeats": int(dict(options)["--repeats"])}
    )
    assert [name.value for name in request.excitations] == [one["name"] for one in said["excitations"]] != []
    assert request.robot == "robot-2"


def test_a_study_is_read_from_its_report_its_file_and_its_folder(tmp_path, capsys):
    write_html(study(tmp_path), tmp_path / "report.html")
    said = [printed(capsys, path) for path in (tmp_path, tmp_path / "study.json", tmp_path / "report.html")]
    assert [one["after"]["verdict"] for one in said] == ["confusable"] * 3
    assert said[0]["excitations"] == said[1]["excitations"] == said[2]["excitations"]
    assert read_study(tmp_path / "report.html").document == read_study(tmp_path).document


def test_people_get_sentences(tmp_path, capsys):
    study(tmp_path)
    assert main([str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "1. slow_ramps (40 s" in text
    assert "ROBOT is the robot that the study is about" in text
    assert "rad/s" in text


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("no json", "no study"),
        ("[]", "no verdict"),
        ('{"verdict": {"verdict": "maybe"}}', "'maybe'"),
        ('{"verdict": {"verdict": "named", "causes": [{"effect": "magic", "where": "x"}]}}', "'magic'"),
        ('{"verdict": {"verdict": "named", "causes": [3]}}', "no study"),
    ],
)
def test_a_broken_study_is_one_clear_error(tmp_path, capsys, content, said):
    (tmp_path / "study.json").write_text(content)
    assert main([str(tmp_path), "--json"]) == 2
    printed = capsys.readouterr()
    error = json.loads(printed.out)["error"]
    assert said in error["detail"] and error["exit_code"] == 2
    assert "study.json" in error["detail"]
    assert printed.err == f"error: {error['detail']}\n"
    assert main([str(tmp_path / "absent.json")]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.parametrize("flags", [["--model", "arm.xml"], ["--excitation", "dance"]])
def test_wrong_usage(capsys, flags):
    with pytest.raises(SystemExit, match="2"):
        main(flags)


@pytest.mark.parametrize("flags", [["--csv", "x.csv", "--excitation", "slide_cube"], ["--csv", "absent/x.csv"]])
def test_a_table_that_cannot_be_written_is_an_error_as_all_are(tmp_path, monkeypatch, capsys, flags):
    monkeypatch.chdir(tmp_path)
    assert main([*flags, "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert (error["title"], error["exit_code"]) == ("wrong usage", 2)
    assert error["detail"]


def test_position_targets_as_a_table(tmp_path, capsys):
    said = printed(capsys, "--csv", tmp_path / "chirps.csv", "--excitation", "chirps", "--seed", 3)
    assert said["csv"] == str(tmp_path / "chirps.csv")
    header = (tmp_path / "chirps.csv").read_text().splitlines()[0].split(",")
    assert header == ["time_s", *c.JOINT_NAMES, *(f"{name}_torque_nm" for name in c.JOINT_NAMES)]
    rows = np.loadtxt(tmp_path / "chirps.csv", delimiter=",", skiprows=1)
    table = targets("chirps", np.random.default_rng(3))
    assert rows[:, 1:10] == pytest.approx(table.position_rad, abs=1e-6)
    assert rows[-1, 0] == pytest.approx(EXCITATIONS["chirps"].duration_s - 0.01)
    assert table.position_rad[round(WAY_UP_S / 0.01) - 1] == pytest.approx(np.tile(RAISED_RAD, 3), abs=0.02)


def test_position_targets_for_another_robot_stay_in_its_range(tmp_path, capsys):
    (tmp_path / "arm.xml").write_text(ARM)
    printed(capsys, "--csv", tmp_path / "arm.csv", "--model", tmp_path / "arm.xml")
    assert (tmp_path / "arm.csv").read_text().splitlines()[0] == "time_s,turn,lift"
    rows = np.loadtxt(tmp_path / "arm.csv", delimiter=",", skiprows=1)
    low, high = np.deg2rad([20.0 - 40.0, 20.0 + 40.0])
    assert rows[0, 1:] == pytest.approx([np.deg2rad(20.0), 0.0], abs=0.02)
    assert rows[:, 1].min() >= low - 1e-6
    assert rows[:, 1].max() <= high + 1e-6
    assert np.ptp(rows[:, 1]) > np.deg2rad(40.0)
    assert np.abs(rows[:, 2]).max() == pytest.approx(0.5)
    document = study(tmp_path) | {"model": "arm.xml"}
    (tmp_path / "study.json").write_text(json.dumps(document))
    said = printed(capsys, tmp_path, "--csv", tmp_path / "again.csv", "--excitation", "standard")
    assert said["model"] == str(tmp_path / "arm.xml")
    first, *_ = said["command"].split(" && ")
    name = said["excitations"][0]["name"]
    assert first == f"trifarm gap excite {tmp_path / 'study.json'} --excitation {name} --csv next-{name}.csv"
    assert (tmp_path / "again.csv").read_text().splitlines()[0] == "time_s,turn,lift", "of the study's arm, no TriFinger's"
    assert main([str(tmp_path)]) == 0
    assert "identify" not in capsys.readouterr().out
    (tmp_path / "study.json").write_text(json.dumps(document | {"model": "gone.xml"}))
    assert main([str(tmp_path), "--csv", str(tmp_path / "none.csv")]) == 2
    assert "--model" in capsys.readouterr().err
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    assert main(["--csv", str(tmp_path / "arm.csv"), "--model", str(tmp_path / "arm.xml")]) == 2
