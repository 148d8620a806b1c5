"""Below its reserve a disk takes nothing new, and says which it is."""

import pytest

from services.disk import Disk
from services.errors import Unavailable
from trial_logs.disk import room


def test_a_disk_with_room_takes_what_is_new(tmp_path):
    Disk(tmp_path, 0).check()
    assert Disk(tmp_path, room(tmp_path).free_bytes // 2).shortage() is None


def test_a_disk_below_its_reserve_is_named_and_takes_nothing(tmp_path):
    disk = Disk(tmp_path, room(tmp_path).total_bytes + 1)
    assert (disk.shortage() or "").startswith("the disk of database and files is full (")
    with pytest.raises(Unavailable, match="Nothing new is accepted") as refused:
        disk.check()
    assert (refused.value.status, refused.value.slug) == (503, "disk-full")
