import pytest

from api_schemas.physics import NAMED_PHYSICS, physics_name


@pytest.mark.parametrize("name", NAMED_PHYSICS)
def test_named_physics_keep_their_names(name):
    assert physics_name(name) == name


@pytest.mark.parametrize("given", ["/secret/place/stiff.toml", "stiff.toml", "stiff", "file:stiff"])
def test_of_a_file_only_the_stem_is_shown_however_often_it_is_asked(given):
    assert physics_name(given) == "file:stiff"
