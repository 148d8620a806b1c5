"""The farm's key is made once."""

import os

from services.signing import KEY_FILE, FarmKey
from tests.disk_steps import in_place, noted_steps


def test_a_key_that_was_half_written_by_a_process_of_the_same_number_hinders_nobody(tmp_path):
    (tmp_path / f"{KEY_FILE}.{os.getpid()}.new").touch()  # in a container the number is the same at each start
    assert FarmKey.of(tmp_path) == FarmKey.of(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [KEY_FILE]


def test_a_key_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    steps = noted_steps(monkeypatch)
    FarmKey.of(tmp_path)
    assert steps == in_place(f"{KEY_FILE}.{os.getpid()}.new", tmp_path / KEY_FILE)
