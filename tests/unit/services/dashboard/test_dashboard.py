"""What the pages are made of: sessions, addresses, figures, and the queue as the list of jobs tells it."""

import numpy as np
import pytest

from api_schemas.anytime import rate_sequence
from api_schemas.success_rate import SHOWN_LEVEL
from services.dashboard import figures, words
from services.dashboard.sessions import Seal
from services.dashboard.sign_in import own_path


def test_a_session_opens_with_its_own_seal_only():
    seal, other = Seal(b"k" * 32), Seal(b"o" * 32)
    cookie = seal.close("trifarm_a_b")
    assert "trifarm_a_b" not in cookie
    assert seal.open(cookie) == "trifarm_a_b"
    assert other.open(cookie) is None
    assert seal.open(cookie[:-4] + "AAAA") is None
    for made_up in ("", "é", "trifarm_a_b", "gAAAA"):
        assert seal.open(made_up) is None
    assert seal.word(cookie) != seal.word(seal.close("trifarm_a_b"))


def test_an_old_session_is_over(monkeypatch):
    import time

    seal = Seal(b"k" * 32)
    cookie = seal.close("trifarm_a_b")
    later = time.time() + 13 * 3600
    monkeypatch.setattr(time, "time", lambda: later)
    assert seal.open(cookie) is None


def test_a_session_that_was_signed_out_opens_no_more():
    seal = Seal(b"k" * 32)
    cookie, other = seal.close("trifarm_a_b"), seal.close("trifarm_a_b")
    respelt = f"{cookie[:9]}!{cookie[9:]}"
    assert seal.open(respelt) == "trifarm_a_b", "base64 skips what is none"
    seal.end(cookie)
    assert seal.open(cookie) is None
    assert seal.open(respelt) is None
    assert seal.open(other) == "trifarm_a_b"


def test_of_too_many_ended_sessions_the_oldest_are_forgotten_and_over(monkeypatch):
    import time

    from services.dashboard import sessions

    monkeypatch.setattr(sessions, "MOST_ENDED", 3)
    ended, now_s = sessions.EndedSessions(), time.time()
    ended.add(b"old", now_s - 1)
    assert not ended.has(b"old", now_s)
    for _ in range(2):
        for number in (2, 0, 3, 1):
            ended.add(b"%d" % number, now_s + 60 + number)
    assert all(ended.has(b"%d" % number, now_s + 60 + number) for number in range(4))
    assert ended.has(b"as old as one that was forgotten", now_s + 60)
    assert not ended.has(b"younger", now_s + 61)


def test_many_ended_sessions_are_remembered_in_no_time():
    import time

    from services.dashboard.sessions import EndedSessions

    ended, until_s, began_s = EndedSessions(), time.time() + 60, time.process_time()
    for number in range(20_000):
        ended.add(b"%d" % number, until_s)
    assert time.process_time() - began_s < 2.0, "0.02 s of the processor, and a minute where each looks at all"
    assert all(ended.has(b"%d" % number, until_s) for number in range(20_000))


def test_an_owner_has_so_many_streams_and_no_more():
    from services.dashboard import live
    from services.errors import TooMany

    streams = live.Streams()
    for _ in range(live.MOST_STREAMS):
        streams.opened("ann")
    with pytest.raises(TooMany):
        streams.opened("ann")
    streams.opened("bob")
    streams.closed("ann")
    streams.opened("ann")


@pytest.mark.parametrize(
    "then, leads_to",
    [
        ("/jobs?q=a", "/jobs?q=a"),
        ("//evil.example", "/"),
        ("/\\evil.example", "/"),
        ("https://evil.example", "/"),
        ("/jobs\r\nSet-Cookie: a=b", "/"),
        ("", "/"),
    ],
)
def test_the_sign_in_leads_to_this_farm_only(then, leads_to):
    assert own_path(then) == leads_to


def test_the_curve_narrows_as_the_confidence_sequence_does():
    curve = figures.narrowing([(1, 1), (2, 1), (40, 30)], 40)
    points = np.array([[float(value) for value in point.split(",")] for point in curve.band.split()])
    assert points.shape == (6, 2)
    low, high = rate_sequence(30, 40, SHOWN_LEVEL)
    assert points[2] == pytest.approx([100, 100 - 100 * high], abs=0.01)
    assert points[3] == pytest.approx([100, 100 - 100 * low], abs=0.01)
    assert figures.narrowing([], 40) == figures.Curve("", "")


def test_errors_lie_between_the_ends_of_their_axis():
    xs = [figures.error_x(error) for error in (0.0, 0.001, 0.02, 0.4, 9.0)]
    assert xs == sorted(xs)
    assert (xs[0], xs[-1]) == (0.0, 100.0)


@pytest.mark.parametrize(
    "seconds, text", [(None, "–"), (-1, "0 s"), (61, "1 min 1 s"), (7200, "2 h"), (90_061, "1 d 1 h"), (59.9, "59 s")]
)
def test_durations_are_read_in_two_units(seconds, text):
    assert words.duration(seconds) == text


def test_angle_errors_lie_on_an_axis_of_half_a_turn():
    near, far = figures.turned([(0.0, True), (np.pi, False)])
    assert (near.x, far.x, near.succeeded, far.succeeded) == (0.0, 100.0, True, False)
    assert figures.angle_x(np.deg2rad(22.5)) == pytest.approx(12.5)


def test_a_moment_is_for_the_readers_browser_to_write_in_its_own_zone():
    assert words.moment("2026-01-02T03:04:05.678+00:00") == (
        '<time datetime="2026-01-02T03:04:05.678+00:00">2026-01-02 03:04:05 UTC</time>'
    )
    assert words.moment(None) == "–"


def test_jobs_that_tried_the_same_goals_stand_together():
    from types import SimpleNamespace

    from services.dashboard.compare_page import grouped

    rows = [SimpleNamespace(job_id=name, task=task, object="cube", object_scale=1.0, seed=seed)
            for name, task, seed in [("a", "push", 1), ("b", "push", 2), ("c", "push", 1), ("d", "lift", 1)]]  # fmt: skip
    assert [([job.job_id for job in group.jobs], group.alike) for group in grouped(rows)] == [
        (["a", "c"], True),
        (["b", "d"], False),
    ]


def test_the_browsers_libraries_are_those_of_the_lock_file():
    import json

    from services.dashboard.pages import FOLDER

    locked = json.loads((FOLDER / "browser" / "package-lock.json").read_text())["packages"]
    licences = (FOLDER / "static" / "licences.txt").read_text()
    for name in ("three", "uplot"):
        version = locked[f"node_modules/{name}"]["version"]
        assert (FOLDER / "static" / f"{name}.js").read_text().startswith(f"/* {name} {version}, MIT")
        assert f"{name} {version}" in licences
    assert licences.count("Permission is hereby granted") == 2


def test_a_log_is_reduced_to_what_is_drawn(short_log, tmp_path):
    import json
    import struct

    from services.dashboard import reduction
    from trial_logs.reader import read_log

    out = tmp_path / "replay.bin"
    reduction.main([str(short_log), str(out)])
    content = out.read_bytes()
    (size,) = struct.unpack("<I", content[:4])
    header, log = json.loads(content[4 : 4 + size]), read_log(short_log)

    def array(name):
        place = header["arrays"][name]
        count = int(np.prod(place["shape"]))
        return np.frombuffer(content, "<f4", count, 4 + size + place["at"]).reshape(place["shape"])

    assert size % 4 == 0
    assert header["duration_s"] == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(array("joint_position_rad"), log.joint_position_rad, rtol=1e-6)
    np.testing.assert_allclose(array("applied_nm"), log.applied_torque_nm, rtol=1e-6)
    np.testing.assert_allclose(array("tracked_pose")[:, :3], log.tracked_position_world_m, rtol=1e-6)
    np.testing.assert_allclose(array("true_pose")[:, :3], log.cube_position_world_m, rtol=1e-6)
    np.testing.assert_allclose(header["goal"][0][:3], log.goal[0])
    assert array("frame_pose").shape[1:] == (len(header["frames"]), 7)
    known = {"world", "cube", *(child for _, child in header["frames"]), *(fixed["child"] for fixed in header["fixed"])}
    assert {entity["frame"] for entity in header["entities"]} <= known
    assert {"arena", "goal", "cube_tracked", "cube"} <= {entity["id"] for entity in header["entities"]}


def test_a_long_log_becomes_no_more_than_a_screen_has_columns(monkeypatch, short_log):
    from services.dashboard import reduction

    monkeypatch.setattr(reduction, "MOST_SAMPLES", 100)
    _, arrays = reduction.reduce(short_log, None)
    assert len(arrays["joint_t_s"]) == 100
    assert np.ptp(np.diff(arrays["joint_t_s"])) < 1e-6


def test_the_truth_comes_from_its_own_file_where_there_is_one(short_log, tmp_path):
    from services.dashboard import reduction
    from sim_backend.trifinger import viewer_scene
    from trial_logs import trial_log

    channels = trial_log.LogChannels(
        joint_names=tuple("abcdefghi"), frames=viewer_scene.MEASURED_FRAMES, topics=trial_log.TRUTH_TOPICS
    )
    steps, positions = np.array([0, 500, 1000]), np.array([[0.0, 0.0, 0.03], [0.1, 0.0, 0.03], [0.1, 0.1, 0.05]])
    with trial_log.TrialLogWriter(tmp_path / "truth.mcap", channels) as writer:
        writer.message(trial_log.TRUE_SCENE, 0, viewer_scene.true_scene())
        writer.cube_pose(steps, positions, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    header, arrays = reduction.reduce(short_log, tmp_path / "truth.mcap")
    np.testing.assert_allclose(arrays["true_t_s"], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(arrays["true_pose"][:, :3], positions)
    assert sum(entity["id"] == "cube" for entity in header["entities"]) == 6, "its sides, once"
