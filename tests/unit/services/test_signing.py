"""The farm's key is made once."""

import os

from services.signing import KEY_FILE, FarmKey


def test_a_key_that_was_half_written_by_a_process_of_the_same_number_hinders_nobody(tmp_path):
    (tmp_path / f"{KEY_FILE}.{os.getpid()}.new").touch()  # in a container the number is the same at each start
    assert FarmKey.of(tmp_path) == FarmKey.of(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [KEY_FILE]
