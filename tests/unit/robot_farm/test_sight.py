"""What finds the object for a robot: the formula or images, as the outcome tells; the formula loads nothing of images."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import tests.unit.sim_backend.vision.before_rendering  # noqa: F401  # see there
from api_schemas.tracker import TrackerName
from api_schemas.trial import Outcome
from robot_farm import checking, trial
from robot_farm.policy.jail import JailedPolicy
from robot_farm.prepared import prepare_plainly
from robot_farm.settings import TOKEN_VARIABLE, parse
from robot_farm.sight import Sight, blind, blind_to
from robot_farm.trial import log_channels, run_trial
from sim_backend.driver.detection import detect
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.tasks import TASKS
from sim_backend.trifinger.objects import shape_of
from sim_backend.vision.cameras import CamerasMissingError
from tests.graphs import linear
from tests.unit.conftest import lease
from trial_logs.images import read_images
from trial_logs.reader import read_log

pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """Outcome and log of the same trial by the kind of tracker; images are kept of the second."""
    folder, tasks = tmp_path_factory.mktemp("sight"), trial.TASKS
    half, found = {"push": dataclasses.replace(TASKS["push"], duration_s=0.4)}, {}
    trial.TASKS = half
    try:
        with JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
            for kind in TrackerName:
                wanted, sight = lease().model_copy(update={"images": kind is TrackerName.IMAGES}), Sight(kind)
                ready = prepare_plainly(wanted, half, sight)
                stop = {"stop_reason": lambda: None, "prepared": ready}
                outcome = run_trial(wanted, policy, SimulatedDriver(), log_channels(), folder / kind.value, **stop)
                sight.close()
                found[kind] = outcome, folder / kind.value
    except CamerasMissingError as error:
        pytest.skip(str(error))
    finally:
        trial.TASKS = tasks
    return found


def test_the_outcome_tells_the_tracker_and_is_as_before_without_images(trials):
    for kind, (outcome, _) in trials.items():
        assert outcome.tracker is kind
        written = outcome.model_dump(mode="json")
        assert ("tracker" in written) == (kind is TrackerName.IMAGES)
        assert Outcome.model_validate(written).tracker is kind


def test_images_find_the_object_where_it_lies_and_report_as_late_as_the_formula(trials):
    formula, images = (read_log(trials[kind][1]) for kind in TrackerName)
    assert images.delivery_s.tolist() == formula.delivery_s.tolist()
    assert images.capture_s.tolist() == formula.capture_s.tolist()
    apart = np.linalg.norm(images.tracked_position_world_m - formula.tracked_position_world_m, axis=1)
    assert 0.0 < apart.max() < 0.008
    assert len(read_images(trials[TrackerName.IMAGES][1])) == 3 * 4


def test_objects_that_images_do_not_know_are_left_to_the_formula():
    sight = Sight(TrackerName.IMAGES)
    assert sight.tracker(shape=shape_of("cuboid"))._detect is detect
    assert sight.detector is None


def test_the_robots_program_takes_a_tracker(monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    told = ["--api", "http://127.0.0.1:1", "--physics", "nominal"]
    assert parse(told).tracker is TrackerName.POSE
    assert parse([*told, "--tracker", "images"]).tracker is TrackerName.IMAGES


def test_a_machine_that_cannot_render_is_told_before_the_farm_starts(monkeypatch, capsys):
    def cannot():
        raise CamerasMissingError("no EGL here")

    monkeypatch.setattr("sim_backend.vision.cameras.Cameras", cannot)
    assert checking.main(["--robots", "1", "--physics", "real", "--tracker", "images"]) == checking.EXIT_USAGE
    assert capsys.readouterr().out == "--tracker images: no EGL here\n"


def test_the_formula_loads_nothing_of_images():
    unwanted = "[name for name in sys.modules if name.split('.')[0] in ('cv2', 'OpenGL') or '.vision' in name]"
    program = f"import sys; from robot_farm.sight import Sight; Sight().tracker(); print({unwanted})"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_a_robot_without_what_renders_is_blind_to_policies_that_see_and_to_nothing_else(monkeypatch):
    monkeypatch.setattr("robot_farm.sight._LIBRARY", "libNoSuchThing.so.1")
    blind.cache_clear()
    try:
        assert blind_to(lease(layout="images")).startswith("this robot has no cameras: libNoSuchThing.so.1 missing; install")
        assert blind_to(lease()) is None
    finally:
        blind.cache_clear()
