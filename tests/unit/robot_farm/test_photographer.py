"""Images of a trial: the instants of the tracker's frames, the robot's own look, and the nominal calibration beside them."""

import dataclasses
import json
import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import tests.unit.sim_backend.vision.before_rendering  # noqa: F401  # see there
from api_schemas.observation import sizes_of
from api_schemas.policy import LAYOUTS
from api_schemas.policy_images import PolicyImages
from robot_farm import trial
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import prepare_plainly
from robot_farm.trial import log_channels, run_trial
from services.dashboard import reduction
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.tasks import TASKS
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras, CamerasMissingError
from tests.graphs import linear, seeing
from tests.unit.conftest import lease
from trial_logs import trial_log
from trial_logs.images import read_images
from trial_logs.reader import read_log

cv2 = pytest.importorskip("cv2")
ASKEW = Physics.of(1, {"camera_pose.right_m": 0.02, "camera_pose.roll_rad": 0.05, "dead_camera.dead": [[0.0, 1.0, 0.0]]})


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs of the same trial by name: without images, with images, and of a robot whose cameras stand askew and one is dead."""
    folder, tasks = tmp_path_factory.mktemp("images"), trial.TASKS
    half = {"push": dataclasses.replace(TASKS["push"], duration_s=0.5)}
    trial.TASKS = half
    try:
        with JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
            for name, images, physics in (
                ("without", False, Physics.nominal()),
                ("with", True, Physics.nominal()),
                ("askew", True, ASKEW),
            ):
                wanted = lease().model_copy(update={"images": images})
                ready = dataclasses.replace(prepare_plainly(wanted, half), physics=physics)
                run_trial(
                    wanted, policy, SimulatedDriver(), log_channels(), folder / name, stop_reason=lambda: None, prepared=ready
                )
    except CamerasMissingError as error:
        pytest.skip(str(error))
    finally:
        trial.TASKS = tasks
    return {name: folder / name for name in ("without", "with", "askew")}


def messages(path, topics):
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(schema.name, message.log_time, found) for schema, _, message, found in reader.iter_decoded_messages(topics)]


def test_images_come_with_the_trackers_frames(logs):
    assert [(image.camera, image.step) for image in read_images(logs["with"])] == [
        (camera, step) for step in range(0, 500, 100) for camera in range(3)
    ]
    captured = {round(each["capture_time_s"] * 1000) for each in read_log(logs["with"]).tracker if each["capture_time_s"] >= 0}
    assert captured and captured <= set(range(0, 500, 100))


def test_an_image_is_what_the_robots_cameras_saw(logs):
    log = read_log(logs["with"])
    place = int(np.flatnonzero(log.cube_steps == 300)[0])
    with Cameras() as cameras:
        seen = cameras.take(log.joint_position_rad[300], log.cube_position_world_m[place], log.cube_quat_wxyz[place])
    for image in read_images(logs["with"]):
        if image.step == 300:
            kept = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
            assert np.abs(kept.astype(int) - seen[image.camera]).mean() < 4.0  # as near as JPEG


def test_the_log_tells_the_nominal_calibration_whatever_the_robot_has(logs):
    for topic, camera in zip(trial_log.CALIBRATIONS, nominal_calibrations(), strict=True):
        plain, askew = (messages(logs[name], [topic]) for name in ("with", "askew"))
        assert plain[0][0] == "foxglove.CameraCalibration" and len(plain) == len(askew) == 1
        assert str(plain[0][2]) == str(askew[0][2])
        assert list(plain[0][2].K) == camera.matrix.ravel().tolist()
        assert list(plain[0][2].D) == camera.distortion.tolist() and plain[0][2].width == 270
    assert transforms(logs["with"]) == transforms(logs["askew"])
    assert read_images(logs["with"])[0].jpeg != read_images(logs["askew"])[0].jpeg, "the images themselves are askew"


def transforms(path):
    found = {}
    for _, _, message in messages(path, [trial_log.MEASURED_TRANSFORMS]):
        found |= {each.child_frame_id: str(each) for each in message.transforms if each.child_frame_id.startswith("camera")}
    assert found.keys() == set(trial_log.CAMERA_NAMES)
    return found


def test_a_dead_camera_gives_no_image(logs):
    assert {image.camera for image in read_images(logs["askew"])} == {0, 2}


def test_the_page_of_a_trial_has_its_images_and_of_too_many_some(logs, monkeypatch):
    kept = read_images(logs["with"])
    assert of_page(logs["with"]) == sorted((image.camera, image.step / 1000, image.jpeg) for image in kept)
    monkeypatch.setattr(reduction, "MOST_IMAGE_BYTES", int(sum(len(image.jpeg) for image in kept) / 2.5))
    assert [(camera, at_s) for camera, at_s, _ in of_page(logs["with"])] == [(c, at) for c in range(3) for at in (0.0, 0.3)]
    assert of_page(logs["without"]) == []
    assert [reduction.reduce(logs[name], None)[0]["has_images"] for name in ("with", "without")] == [True, False]


def of_page(log):
    """Camera, time in s and JPEG file of each image."""
    made = reduction.images(log)
    (length,) = struct.unpack_from("<I", made)
    listed = json.loads(made[4 : 4 + length])["images"]
    return [(camera, at_s, made[4 + length + at : 4 + length + at + size]) for camera, at_s, at, size in listed]


def test_images_change_nothing_else_of_a_log(logs):
    one, other = read_log(logs["without"]), read_log(logs["with"])
    assert read_images(logs["without"]) == ()
    for field in ("joint_position_rad", "applied_torque_nm", "cube_position_world_m", "tracked_position_world_m", "observation"):
        assert (getattr(one, field) == getattr(other, field)).all()
    more = other.message_counts.keys() - one.message_counts.keys()
    assert more == {*trial_log.IMAGES, *trial_log.CALIBRATIONS}


def test_without_images_nothing_of_them_is_loaded():
    """A robot's process imports neither the renderer nor OpenCV before a job asks for images."""
    import os
    import subprocess
    import sys

    env = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}  # which has MuJoCo itself load OpenGL
    unwanted = "[name for name in sys.modules if name.split('.')[0] in ('cv2', 'OpenGL', 'av') or '.vision' in name]"
    found = subprocess.run(
        [sys.executable, "-c", f"import sys, robot_farm.robot; print({unwanted})"],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == "[]"


def test_a_policy_that_sees_gets_the_images_of_the_frames_that_have_arrived(tmp_path, monkeypatch):
    """Its torques are the means of what it is shown: those of the log's images, as late as the tracker's reports of them."""
    monkeypatch.setattr(trial, "TASKS", {"push": dataclasses.replace(TASKS["push"], duration_s=0.5)})
    wanted = lease(layout="images").model_copy(update={"images": True})
    try:
        with JailedPolicy("sees", seeing(tmp_path / "p.onnx"), images=PolicyImages()) as policy:
            run_trial(wanted, policy, SimulatedDriver(), log_channels(), tmp_path / "log", stop_reason=lambda: None)
    except CamerasMissingError as error:
        pytest.skip(str(error))
    log = read_log(tmp_path / "log")
    means = {}
    for image in read_images(tmp_path / "log"):
        kept = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        means.setdefault(image.step, np.zeros((3, 3)))[image.camera] = kept.mean(axis=(0, 1))
    delay = LAYOUTS["images"].observation.index("tracker_delay_s")
    at = sum(sizes_of(LAYOUTS["images"].observation)[:delay])
    captured = np.rint(1000 * (np.arange(len(log.action)) / 10 - log.observation[:, at])).astype(int)
    assert len(set(captured)) > 3 and (captured < np.arange(0, 500, 100)).all(), "new images, and none of now"
    for step, action in zip(captured, log.action, strict=True):
        np.testing.assert_allclose(action.reshape(3, 3) * 255 / 0.3, means[max(step, 0)], atol=2.0)  # as near as JPEG
    assert 20 < np.mean(list(means.values())) < 235
