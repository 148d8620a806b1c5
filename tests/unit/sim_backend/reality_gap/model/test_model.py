"""The extended model: its file reads back to the same bits, robots run on it, and what is not right in it is refused."""

from datetime import UTC, datetime
from hashlib import sha256

import numpy as np
import pytest

from robot_farm.hidden_physics import HiddenPhysics
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.estimate import PLACES, Draw
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.reality_gap.model.model import (
    extended_model,
    load_extended_model,
    provenance_of,
    toml,
    write_extended_model,
)
from sim_backend.reality_gap.verdict import Cause
from sim_backend.training.randomization import ranges_to_train_on
from sim_backend.trifinger import constants as c

JOINT = c.JOINT_NAMES[4]
FRICTION = Cause("coulomb_friction", "torque_nm", JOINT, 0.1 + 0.2 - 0.27, "N m", (0.02871828, 1 / 30))
DELAY = Cause("action_delay", "delay_s", "all joints", 0.0026, "s", (0.0021, 0.0033))
MASS = Cause("cube_mass", "factor", "cube", 1.1, "", (1.0, 1.2))
TIP = Cause("gravity", "offset_m_s2", "z", 0.19, "m/s^2", (0.1, 0.25))


def model(*causes, tmp_path):
    data = tmp_path / 'a "quoted" log.mcap'
    data.write_bytes(b"measured")
    said = provenance_of("robot-1, session\n2", "named", [data], now=datetime(2026, 11, 21, tzinfo=UTC))
    return extended_model(causes, said, about="with a\ttab and \x7f")


def test_a_file_reads_back_to_the_same_bits(tmp_path):
    wrote = model(FRICTION, DELAY, MASS, TIP, tmp_path=tmp_path)
    write_extended_model(wrote, tmp_path / "extended.toml")
    read = load_extended_model(tmp_path / "extended.toml")
    assert read.physics.document() == wrote.physics.document()
    assert (read.estimate, read.about) == (wrote.estimate, wrote.about)
    assert read.causes == (FRICTION, DELAY, MASS, TIP)
    said = read.estimate.provenance
    assert said is not None
    assert said.data[0].sha256 == sha256(b"measured").hexdigest()
    assert (said.title, said.created) == ("robot-1, session\n2", "2026-11-21T00:00:00+00:00")
    assert said.code.startswith("trifarm ")


@pytest.mark.parametrize("key", PARAMETERS)
def test_every_parameter_of_the_catalogue_survives(key, tmp_path):
    parameter, (effect, _, name) = PARAMETERS[key], key.partition(".")
    value = parameter.lower + (parameter.upper - parameter.lower) / 3
    where = PLACES[parameter.scope][-1] if parameter.width > 1 else ""
    cause = Cause(effect, name, where, value, parameter.unit, (parameter.lower, parameter.upper))
    write_extended_model(extended_model([cause], None), tmp_path / "one.toml")
    read = load_extended_model(tmp_path / "one.toml")
    assert read.causes == (cause,)
    assert read.physics.value(key).reshape(-1)[-1] == value
    assert (read.physics.value(key).reshape(-1)[:-1] == parameter.absent).all()


def test_robots_run_on_it(tmp_path):
    write_extended_model(model(FRICTION, DELAY, tmp_path=tmp_path), tmp_path / "extended.toml")
    ranges = load_ranges(tmp_path / "extended.toml")
    robots = ranges.draw(np.random.default_rng(0), 2)
    assert ranges.estimate.intervals[0].high == 1 / 30
    assert (robots.value("coulomb_friction.torque_nm")[:, 4] == FRICTION.value).all()
    assert (robots.value("action_delay.delay_s") == DELAY.value).all()
    farm = HiddenPhysics(b"secret", "robot-0", str(tmp_path / "extended.toml"))
    assert farm.physics.document() == robots.row(0).document()
    assert SimulatedDriver(robots=2, physics=robots).physics.has("action_delay")


def test_on_top_of_what_the_study_began_with():
    nominal = Physics.of(1, {"viscous_friction.damping_nm_s_rad": 0.01, "coulomb_friction.torque_nm": 0.02})
    physics = extended_model([FRICTION], None, nominal=nominal).physics
    assert (physics.value("viscous_friction.damping_nm_s_rad") == 0.01).all()
    assert physics.value("coulomb_friction.torque_nm")[0].tolist() == [0.02] * 4 + [FRICTION.value] + [0.02] * 4


def test_training_draws_from_the_intervals_and_nothing_else(tmp_path):
    out = tmp_path / "extended.toml"
    write_extended_model(model(FRICTION, DELAY, MASS, tmp_path=tmp_path), out)
    ranges = ranges_to_train_on(str(out))
    assert ranges.estimate.draws is Draw.INTERVAL_90
    robots = ranges.draw(np.random.default_rng(0), 400)
    friction, delay = robots.value("coulomb_friction.torque_nm"), robots.value("action_delay.delay_s")
    low, high = FRICTION.interval_90
    assert low <= friction[:, 4].min() < low + 0.05 * (high - low)
    assert high >= friction[:, 4].max() > high - 0.05 * (high - low)
    assert (np.delete(friction, 4, axis=1) == 0.0).all()
    assert (delay == delay[:, :1]).all() and len(np.unique(delay)) == 400
    assert robots.value("cube_mass.factor").std() == pytest.approx(0.2 / 12**0.5, rel=0.1)
    again = ranges.draw(np.random.default_rng(0), 400)
    assert (again.value("cube_mass.factor") == robots.value("cube_mass.factor")).all()


@pytest.mark.parametrize(
    ("cause", "message"),
    [
        (Cause("coulomb", "torque_nm", JOINT, 0.1, "", (0, 1)), "unknown effect 'coulomb'"),
        (Cause("coulomb_friction", "torque", JOINT, 0.1, "", (0, 1)), "no parameter 'torque'; choose from torque_nm"),
        (Cause("coulomb_friction", "torque_nm", "elbow", 0.1, "", (0, 1)), "no value for 'elbow'; choose from finger0"),
        (Cause("coulomb_friction", "torque_nm", JOINT, 9.0, "", (0, 1)), "between 0 and 0.5 N m"),
    ],
)
def test_causes_that_cannot_be(cause, message):
    with pytest.raises(ValueError, match=message):
        extended_model([cause], None)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("title =", "titel ="), "provenance: unknown titel; choose from title"),
        (('code = "trifarm', 'coda = 1\ncode = "trifarm'), "unknown coda"),
        (('verdict = "named"\n', ""), "verdict is missing"),
        (("sha256 = ", "sha256 = 'x'\n# "), "64 hexadecimal digits"),
        (("low = 0.0021", "low = 0.0021\nmid = 1"), "interval_90 1: unknown mid"),
        (("low = 0.0021", "low = 0.1"), "the first not larger"),
        (("low = 0.0021", "low = true"), "low is True"),
        (('where = "all joints"', 'where = "elbow"'), "no value for 'elbow'"),
        (('key = "action_delay.delay_s"', 'key = "action_delay.late"'), "unknown parameter 'action_delay.late'"),
        (("[provenance]", "[origin]\nx = 1\n[provenance]"), "unknown effect 'origin'"),
        (("[action_delay]", 'draw = "often"\n[action_delay]'), "draw is 'often'; choose from value, interval_90"),
        (("[[interval_90]]", "[interval_90]"), "must be a list of tables"),
    ],
)
def test_files_that_are_wrong(change, message, tmp_path):
    text = toml(model(DELAY, tmp_path=tmp_path))
    assert change[0] in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(change[0], change[1], 1), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        load_extended_model(path)


def test_ranges_are_no_model_of_one_robot():
    with pytest.raises(ValueError, match="use load_ranges"):
        load_extended_model("mild")
