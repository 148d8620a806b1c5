"""What the network learns from: places on the cube are where its pixels look, and changes of crops leave them there."""

import numpy as np
import pytest

from sim_backend.vision.cameras import CamerasMissingError
from sim_backend.vision.lessons import CROP_PX, on_faces, render_robot


@pytest.fixture(scope="module")
def crops():
    """Those of two scenes of one robot."""
    pytest.importorskip("cv2")
    try:
        return render_robot(3, 2)
    except CamerasMissingError as error:
        pytest.skip(str(error))


def test_rays_meet_faces_where_they_do():
    face, eye = np.array([1, 4, 0]), np.array([3.0, -4.0, 0.5])
    towards = np.array([[1.0, 0.2, 0.3], [0.5, -1.0, -0.7], [0.0, 0.0, 0.0]]) - eye
    np.testing.assert_allclose(on_faces(face, eye, towards), [[1.0, 0.2, 0.3], [0.5, -1.0, -0.7], [0, 0, 0]])


def test_places_lie_on_the_faces_they_are_of(crops):
    assert crops["image"].shape == (8, CROP_PX, CROP_PX, 3) and (crops["face"][:3] > 0).any()
    face, place = crops["face"], crops["place"] / 127.0
    for number in range(1, 7):
        axis, sign = (number - 1) // 2, 1 - 2 * ((number - 1) % 2)
        np.testing.assert_allclose(place[face == number][:, axis] * sign, 1.0)
    assert (place[face == 0] == 0).all() and np.abs(place).max() <= 1.0


def test_the_network_learns_a_crop(crops):
    torch = pytest.importorskip("torch")
    from sim_backend.vision.tracker_network import TrackerNetwork, loss_of
    from sim_backend.vision.tracker_training import SHOWN_PX, shown

    torch.manual_seed(1)
    network = TrackerNetwork()
    optimiser, losses = torch.optim.Adam(network.parameters(), 3e-3), []
    image, face, place = shown(crops, torch.arange(2), None)
    assert image.shape == (2, 3, SHOWN_PX, SHOWN_PX) and (face == -1).any()
    for _ in range(12):
        optimiser.zero_grad()
        loss, _, _ = loss_of(network(image), face, place)
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.7 * losses[0]


def test_changes_hide_some_pixels_and_move_none(crops):
    torch = pytest.importorskip("torch")
    from sim_backend.vision.tracker_training import shown

    rows, hidden = torch.arange(6), 0
    for seed in range(6):
        image, face, place = shown(crops, rows, torch.Generator().manual_seed(seed))
        assert float(image.min()) >= 0.0 and float(image.max()) <= 1.0
        axis = (face.clamp(min=1) - 1) // 2
        on_face = place.gather(1, axis[:, None])[:, 0][face > 0].abs()
        assert (on_face > 0.99).all()
        hidden += int(((place.abs().sum(dim=1) > 0) & (face == 0)).sum())
    assert hidden > 0
