"""Pictures and films of a log: images that it keeps, else what was measured; and what cannot be shown says why."""

import json

import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.vision.__main__ import EXIT_USAGE, main
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import CamerasMissingError
from sim_backend.vision.film import write_film
from sim_backend.vision.pictures import as_file, as_jpeg, from_jpeg, with_object
from sim_backend.vision.views import Views, measured_at
from trial_logs.reader import read_log

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def drawn(short_log):
    try:
        with Views(short_log, drawn=True) as views:
            yield views.at(0.5)[0]
    except CamerasMissingError as error:
        pytest.skip(str(error))


def test_a_log_without_images_is_drawn_from_what_was_measured(drawn, short_log, nominal_cameras):
    log = read_log(short_log)
    moment = measured_at(log, 0.5)
    np.testing.assert_array_equal(moment.joint_position_rad, log.joint_position_rad[500])
    images = nominal_cameras.take(moment.joint_position_rad, moment.position_world_m, moment.quat_wxyz)
    assert drawn.shape == (270, 810, 3) and (drawn == np.hstack(list(images))).all()


def test_the_object_is_where_the_tracker_saw_it_then(short_log):
    log = read_log(short_log)
    report = int(np.searchsorted(log.capture_s, 0.3))
    moment = measured_at(log, float(log.capture_s[report]))
    np.testing.assert_allclose(moment.position_world_m, log.tracked_position_world_m[report], atol=1e-9)


def test_the_command_writes_a_picture_and_a_film(short_log, tmp_path, capsys, drawn):
    picture, film = tmp_path / "view.png", tmp_path / "trial.mp4"
    assert main(["look", str(short_log), "--at", "0.5", "--out", str(picture), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == {"file": str(picture), "images": "drawn from what was measured", "exposed_s": 0.5}
    np.testing.assert_array_equal(cv2.imread(str(picture))[..., ::-1], drawn)
    pytest.importorskip("av")
    assert main(["video", str(short_log), "--out", str(film), "--rate", "4"]) == 0
    assert frames_of(film) == (4, 810, 270)


def frames_of(path) -> tuple[int, int, int]:
    """Frames, width and height of a film as another decoder has them: OpenCV's."""
    film, count = cv2.VideoCapture(str(path)), 0
    while film.read()[0]:
        count += 1
    return count, int(film.get(cv2.CAP_PROP_FRAME_WIDTH)), int(film.get(cv2.CAP_PROP_FRAME_HEIGHT))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["look", "LOG", "--at", "99", "--out", "view.png"], "99 s is outside of the trial"),
        (["look", "LOG", "--out", "view.gif"], "a picture is .gif; choose from .png, .jpg and .jpeg"),
        (["video", "LOG", "--out", "trial.avi"], "a film is .avi; choose from .mp4 and .webm"),
        (["video", "LOG", "--out", "trial.mp4", "--rate", "0"], "the rate is 0 Hz"),
        (["look", __file__, "--out", "view.png"], "it is no MCAP file"),
    ],
)
def test_what_cannot_be_shown_says_why(arguments, says, short_log, capsys, drawn):
    assert main([str(short_log) if each == "LOG" else each for each in arguments]) == EXIT_USAGE
    assert says in capsys.readouterr().err


def test_a_film_that_fails_leaves_no_file(tmp_path):
    pytest.importorskip("av")

    def frames():
        yield np.zeros((64, 64, 3), np.uint8)
        raise KeyError("the scene is gone")

    with pytest.raises(KeyError):
        write_film(tmp_path / "trial.mp4", frames(), 10.0)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_comes_back_from_its_file():
    image = np.zeros((20, 30, 3), np.uint8)
    image[:, 10:] = (200, 90, 20)
    assert (cv2.imdecode(np.frombuffer(as_file(image, ".png"), np.uint8), 1)[..., ::-1] == image).all()
    assert np.abs(from_jpeg(as_jpeg(image)).astype(int) - image)[:, 16:].max() < 12
    with pytest.raises(ValueError, match="3 bytes are no JPEG image"):
        from_jpeg(b"abc")


def test_edges_are_drawn_where_the_calibration_puts_them():
    camera, position = nominal_calibrations()[0], np.array([0.0, 0.0, 0.05])
    drawn = with_object(np.zeros((270, 270, 3), np.uint8), camera, position, np.eye(3))
    rows, columns = np.nonzero(drawn[..., 0] > 60)
    corners = camera.project(
        position + c.CUBE_WIDTH_M / 2 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    )
    assert abs(columns.min() - corners[:, 0].min()) < 2 and abs(rows.max() - corners[:, 1].max()) < 2
