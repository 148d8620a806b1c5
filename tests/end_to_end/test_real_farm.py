"""Farms whose robots differ: hidden physics stays hidden, sick robots leave, objects and identification go the same way."""

import functools
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.replays.replay import EXIT_DIFFERS
from sim_backend.trifinger.constants import START_JOINT_POSITION_RAD as START_RAD
from tests.end_to_end.farm import Farm
from tests.end_to_end.reaching import reaching
from trial_logs.reader import read_log
from trial_logs.trial_log import EVENTS, MANIFEST_ATTACHMENT, MEASURED_TOPICS, MODEL_ATTACHMENT, STEP_NS, TORQUE, TRACKER

ROOT = Path(__file__).parent.parent.parent
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
STUCK = "robot-1:stuck_joint:finger120_upper_to_middle@1"
DEAD = "robot-2:dead_camera:camera180@1"
TRIALS, LATER_TRIALS = 4, 12


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    """Robot 0 stays well; from their second trials on robot 1 has a stuck joint and robot 2 a dead camera."""
    more = ("--physics", "real", "--farm-seed", "99", "--fault", STUCK, "--fault", DEAD)
    with Farm(tmp_path_factory.mktemp("real"), robots=3, more=more) as farm:
        yield farm


@pytest.fixture(scope="module")
def job(farm) -> str:
    """A job that every robot begins."""
    job = farm.submit(REFERENCE, trials=TRIALS, seed=7)
    farm.run("watch", job)
    return job


@pytest.fixture(scope="module")
def until_tested(farm, job, tmp_path_factory) -> str:
    """The job after it, until every robot has tested itself again."""
    later = farm.submit(reaching(tmp_path_factory.mktemp("reaching")), task="reach", trials=LATER_TRIALS, seed=7)
    farm.run("watch", later)
    return later


@pytest.fixture(scope="module")
def logs(farm, job, tmp_path_factory) -> Path:
    """A folder with those of the job."""
    folder = tmp_path_factory.mktemp("logs")
    farm.run("fetch", job, "--to", str(folder))
    return folder


def test_sick_robots_leave_with_a_reason_and_their_trials_run_elsewhere(farm, job, until_tested):
    first, later = reports = [farm.report(each) for each in (job, until_tested)]
    assert [len(report["per_trial"]) for report in reports] == [TRIALS, LATER_TRIALS]
    assert [report["policy_faults"] for report in reports] == [0, 0]
    robots = {robot["robot"]: robot for robot in farm.json("robots")["robots"]}
    assert robots["robot-0"]["state"] == "idle"
    assert robots["robot-1"]["state"] == robots["robot-2"]["state"] == "out_of_service"
    assert "finger120_upper_to_middle" in robots["robot-1"]["reason"]
    assert "camera180" in robots["robot-2"]["reason"]
    assert {fault["robot"] for report in reports for fault in report["platform_fault_attempts"]} == {"robot-1", "robot-2"}
    assert first["platform_faults"] + later["platform_faults"] == 2
    tried = [row["robot"] for report in reports for row in report["per_trial"]]
    assert max(tried.count("robot-1"), tried.count("robot-2")) <= 6, "one self-test every five trials"
    assert "between_robots" in first
    assert not farm.json("status")["healthy"]


def test_a_log_holds_nothing_that_is_hidden(farm, logs):
    log = read_log(logs / "trial-000.mcap")
    assert not any(topic.startswith("/truth") for topic in log.message_counts)
    assert log.metadata["physics"] == "real"
    texts = texts_of(logs / "trial-000.mcap")
    del texts[MANIFEST_ATTACHMENT]  # of the user's own
    everything = "\n".join(text for found in texts.values() for text in found)
    assert all(texts[topic] for topic in (EVENTS, TRACKER, "metadata", MODEL_ATTACHMENT))
    assert "capture_time_s" in everything and log.metadata["trial_id"] in everything and "<mujoco" in everything
    hidden = set(PARAMETERS) | {key.split(".")[0] for key in PARAMETERS} | {"noise_seed", "motor_temperature_rise_k"}
    hidden |= {name for key in PARAMETERS if "_" in (name := key.split(".")[1])}  # a single word may mean anything
    assert len(hidden) > 100 and not [word for word in hidden if f'"{word}"' in everything]
    effects = physics_of(farm, log.metadata["robot"])["effects"]
    drawn = {repr(number) for number in numbers_in(effects) if len(repr(number)) > 8}
    assert len(drawn) > 50 and not [number for number in drawn if number in everything]
    assert (log.confidence < 1.0).any()
    honest = farm.json("replay", str(logs / "trial-000.mcap"), "--verify")
    assert honest["same"] and honest["first_difference_step"] is None


def texts_of(log: Path) -> dict[str, list[str]]:
    """All that can be read in a log as text, by topic: strings of its decoded messages, JSON, metadata and attachments."""
    texts: dict[str, list[str]] = defaultdict(list)
    with log.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                texts[channel.topic].append(json.dumps(json.loads(message.data)))
        for _, channel, _, decoded in reader.iter_decoded_messages([t for t in MEASURED_TOPICS if t != TRACKER]):
            texts[channel.topic] += [str(value) for field, value in decoded.ListFields() if isinstance(value, str)]
            texts[channel.topic].append(" ".join(field.name for field in decoded.DESCRIPTOR.fields))
        texts["metadata"] = [f'"{key}" {value}' for record in reader.iter_metadata() for key, value in record.metadata.items()]
        for file in reader.iter_attachments():
            texts[file.name] = [file.data.decode()]
    return texts


def was_placed(log: Path) -> bool:
    """Whether somebody put the object down before the trial."""
    with log.open("rb") as stream:
        events = make_reader(stream).iter_messages(topics=[EVENTS])
        return any(b"the object was placed" in message.data for _, _, message in events)


def numbers_in(document) -> list[float]:
    """All numbers of a nested document."""
    if isinstance(document, dict):
        return [number for value in document.values() for number in numbers_in(value)]
    if isinstance(document, list):
        return [number for value in document for number in numbers_in(value)]
    return [float(document)]


@functools.cache
def physics_of(farm, robot: str) -> dict:
    """What a robot is really like, as an operator may look it up; asked once of each, since it stays so."""
    return farm.json("physics", "--robot", robot, "--data", str(farm.folder / "data"), "--farm-seed", "99")


def test_a_placed_trial_does_not_give_the_encoders_away(farm, logs):
    placed = [path for path in sorted(logs.glob("trial-*.mcap")) if was_placed(path)]
    assert placed, "the first trial of every robot starts with a placement"
    for path in placed:
        log = read_log(path)
        effects = physics_of(farm, log.metadata["robot"])["effects"]
        offset_rad = np.array(effects["encoder_offset"]["offset_rad"])
        shown_rad = log.joint_position_rad[0] - START_RAD
        assert np.abs(offset_rad).max() > 4e-3
        assert np.abs(shown_rad).max() < 1e-4, "one count of an encoder is 3.5e-5 rad"


def forge(log: Path, forged: Path, *, topic: str, step: int) -> None:
    """A copy, whole and well-formed, in which one number of one message is another."""
    with log.open("rb") as stream, forged.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out)
        writer.start()
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                schema_id = schemas[schema.id]
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id, channel.metadata
                )
            data = message.data
            if channel.topic == topic and message.log_time == step * STEP_NS:
                data = data[:-1] + bytes([data[-1] ^ 1])  # the exponent of the last double
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time, message.sequence)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        for file in reader.iter_attachments():
            writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        writer.finish()


def test_a_forged_log_is_found_out_by_the_server(farm, logs, tmp_path):
    """`test_a_log_holds_nothing_that_is_hidden` has it verified as it is."""
    log, forged = logs / "trial-000.mcap", tmp_path / "forged.mcap"
    forge(log, forged, topic=TORQUE, step=700)
    found = farm.json("replay", str(forged), "--verify", code=EXIT_DIFFERS)
    assert not found["same"] and found["first_difference_step"] == 700
    assert found["largest_joint_difference_rad"] == 0.0, "only a torque was forged"
    forged.write_bytes(log.read_bytes()[:-1000])
    farm.run("replay", str(forged), "--verify", code=2)


def test_truth_is_for_operators(farm, job, tmp_path):
    user = farm.json("token", "create", "--owner", "ada", "--scope", "submit")["secret"]
    farm.run("fetch", job, "--to", str(tmp_path / "all"), "--truth")
    assert len(list((tmp_path / "all").glob("*.truth.mcap"))) == TRIALS
    before, farm.env = farm.env, farm.env | {"TRIFARM_TOKEN": user}
    try:
        farm.run("fetch", job, "--to", str(tmp_path / "mine"), "--truth", code=None)
        assert not list((tmp_path / "mine").glob("*.truth.mcap"))
    finally:
        farm.env = before


def test_an_operator_may_look_and_sees_what_the_seed_gives(farm):
    seen, again = (physics_of(farm, robot) for robot in ("robot-0", "robot-1"))
    assert set(seen["effects"]) and seen["robot"] == "robot-0"
    assert seen["effects"] != again["effects"]


@pytest.mark.parametrize("kind", ["cuboid", "sphere", "octagonal_prism"])
def test_other_objects_go_the_same_way(farm, kind):
    job = farm.json("submit", str(REFERENCE), "--task", "push", "--trials", "1", "--seed", "3", "--object", kind)["job_id"]
    report = farm.report(job)
    assert report["object"] == kind and report["policy_faults"] == 0 and len(report["per_trial"]) == 1


BRIEF = ("hold_poses", "slide_cube")
EVERY = (*BRIEF, "slow_ramps", "fast_sweeps", "joint_limits", "chirps", "oscillations", "standard")


@pytest.mark.parametrize("asked", [BRIEF, pytest.param((), marks=pytest.mark.scale)], ids=["brief", "all"])
def test_identification_brings_a_log_of_every_excitation(farm, asked, tmp_path):
    """`test_identification_brings_a_log_of_every_excitation` asks for two of them without scale."""
    named = [word for name in asked for word in ("--excitation", name)]
    assert farm.json("identify", "--robot", "any", *named, "--to", str(tmp_path), "--wait")
    found = [read_log(log).metadata["excitation"] for log in tmp_path.glob("*.mcap")]
    assert sorted(found) == sorted(asked or EVERY)
