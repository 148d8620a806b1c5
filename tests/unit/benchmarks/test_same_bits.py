"""The comparison of two recorded jobs: blind for clocks and ids, and for nothing else."""

import json

import pytest
from mcap.writer import CompressionType, Writer

from tests.benchmarks.same_bits import compared, table

OUTCOME = {"kind": "succeeded", "measures": {"episode_return": 19.25}, "wall_s": 0.5, "policy_timing": {"mean_ms": 0.1}}


def report(trial_id="ja-000", created_at="2026-01-01T00:00:00Z", **outcome):
    row = {"trial": 0, "trial_id": trial_id, "robot": "robot-0", "log_sha256": trial_id, "outcome": OUTCOME | outcome}
    return {"job_id": trial_id[:-4], "created_at": created_at, "successes": 1, "per_trial": [row]}


def log(
    path, trial_id="ja-000", torque=b"\x01\x02", at_ns=1_000_000, inference_ns=7, compression=CompressionType.ZSTD, mass="0.08"
):
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start()
        schema = writer.register_schema("trifarm.Any", "protobuf", b"fields")
        messages = {
            "/measured/torque": torque,
            "/measured/policy": b"observation" + b"\x19" + inference_ns.to_bytes(8, "little"),
            "/measured/events": f"trial {trial_id}, attempt 1".encode(),
        }
        for topic, data in messages.items():
            writer.add_message(writer.register_channel(topic, "protobuf", schema), at_ns, data, at_ns)
        writer.add_attachment(0, 0, "model.xml", "application/xml", b"<mujoco/>")
        writer.add_metadata("trial", {"trial_id": trial_id, "robot": "robot-0", "versions": trial_id})
        writer.add_metadata("outcome", {"kind": "succeeded", "wall_s": trial_id})
        writer.add_metadata("physics", {"mass_kg": mass})
        writer.finish()


def folder(path, report, **of_log):
    path.mkdir()
    (path / "report.json").write_text(json.dumps(report))
    log(path / "trial-000.mcap", **of_log)
    return path


@pytest.fixture
def old(tmp_path):
    return folder(tmp_path / "old", report())


def test_clocks_ids_and_compression_are_no_difference(old, tmp_path):
    other = report("jb-000", "2027-01-01T00:00:00Z", wall_s=9.0, policy_timing=None)
    new = folder(tmp_path / "new", other, trial_id="jb-000", inference_ns=9, compression=CompressionType.NONE)
    comparison = compared(old, new)
    assert comparison.differences == (), table(comparison)
    assert comparison.rows["log /measured/torque"] == (1, 1, 0)
    assert table(comparison).endswith("the same bits")


@pytest.mark.parametrize(
    ("changed", "part"),
    [
        ({"torque": b"\x01\x03"}, "/measured/torque"),
        ({"at_ns": 2_000_000}, "/measured/policy"),
        ({"mass": "0.080000001"}, "metadata physics"),
    ],
)
def test_one_other_bit_of_a_log_is_a_difference(old, tmp_path, changed, part):
    comparison = compared(old, folder(tmp_path / "new", report(), **changed))
    assert f"trial-000.mcap {part}: other bits (messages 1 != 1)" in comparison.differences
    assert table(comparison).endswith("DIFFERENT")


def test_another_measure_of_the_report_is_a_difference(old, tmp_path):
    comparison = compared(old, folder(tmp_path / "new", report(measures={"episode_return": 19.250000000000004})))
    assert comparison.differences == ("report.per_trial[0].outcome.measures.episode_return: 19.25 != 19.250000000000004",)


def test_a_log_that_is_missing_is_a_difference(old, tmp_path):
    new = folder(tmp_path / "new", report())
    (new / "trial-000.mcap").unlink()
    assert compared(old, new).differences == ("trial-000.mcap: only in one of the folders",)
