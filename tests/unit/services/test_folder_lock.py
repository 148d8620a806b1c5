"""Several processes may serve one folder; whoever ended holds nothing."""

from services.folder_lock import LOCK, held, is_held


def test_a_folder_is_held_until_the_last_has_left_it(tmp_path):
    path = tmp_path / LOCK
    assert not is_held(path)
    with held(tmp_path):
        assert is_held(path)
        with held(tmp_path):
            assert is_held(path)
        assert is_held(path)
    assert not is_held(path)
