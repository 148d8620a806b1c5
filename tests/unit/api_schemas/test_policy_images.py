"""Images in a manifest: the shapes that there are, names of their own, and digests that know nothing of them."""

import pytest
from pydantic import ValidationError

from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json
from api_schemas.policy_images import IMAGE_PX, PolicyImages


@pytest.mark.parametrize("edge", IMAGE_PX)
def test_each_pixel_is_the_mean_of_whole_pixels_of_the_camera(edge):
    images = PolicyImages(shape=(3, edge, edge, 3))
    assert 270 % edge == 0 and images.edge_px == edge and images.size == 27 * (edge // 3) ** 2 * 3


@pytest.mark.parametrize("shape", [(3, 100, 100, 3), (1, 270, 270, 3), (3, 3, 270, 270), (3, 135, 270, 3), (3, 2**20, 2**20, 3)])
def test_another_shape_is_refused_with_those_that_there_are(shape):
    with pytest.raises(ValidationError, match=r"choose \[3, n, n, 3\] with n of 270, 135"):
        PolicyImages(shape=shape)


def test_images_need_an_input_of_their_own_and_no_recurrent_cell():
    state = {"input": "images", "output": "next", "shape": [1, 4]}
    with pytest.raises(ValidationError, match="images an input"):
        PolicyManifest(observation=("robot_id",), states=(state,), images=PolicyImages())
    with pytest.raises(ValidationError, match="images for ONNX"):
        PolicyManifest(observation=("robot_id",), recurrent="gru", images=PolicyImages())


def test_manifests_without_images_are_spelt_as_before():
    assert all(("images" in canonical_json(each).partition("name")[0]) == (each.images is not None) for each in LAYOUTS.values())
    assert LAYOUTS["images"].images == PolicyImages()
