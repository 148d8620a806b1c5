"""A robot's reserve, on a real file system whose room a test decides by its own ballast."""

import subprocess

import pytest

from robot_farm.reserve import NAME, STEP_BYTES, Reserve

MB = 1 << 20


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 8 MB."""
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(tmp_path)], check=False).returncode:
        pytest.skip("only root can mount a small file system")
    yield tmp_path
    subprocess.run(["umount", "-l", str(tmp_path)], check=True)


def kept(folder) -> int:
    return (folder / NAME).stat().st_blocks * 512 if (folder / NAME).exists() else 0


def test_robots_of_one_disk_keep_as_many_reserves_as_there_is_room_for(small_disk):
    folders = [small_disk / name for name in ("a", "b", "c")]
    said: list[str] = []
    for folder in folders:
        folder.mkdir()
    reserves = [Reserve(folder, 3 * MB, said.append, left_bytes=MB) for folder in folders]
    for each in reserves:
        each.take()
    assert [each.lacks is None for each in reserves] == [True, True, False]
    assert [kept(folder) for folder in folders] == [3 * MB, 3 * MB, 0]
    assert "of 8.39 MB, is full" in (reserves[2].lacks or "") and len(said) == 1
    reserves[0].shrink_to(0)
    reserves[2].take()
    assert reserves[2].lacks is None and said[-1] == "has room on its disk again"


def test_the_reserve_gives_way_to_the_log_and_grows_with_large_ones(small_disk):
    reserve = Reserve(small_disk, 2 * MB, print, left_bytes=0)
    reserve.take()
    log = small_disk / "log"
    log.write_bytes(bytes(MB // 2))
    reserve.follow(log, small_disk / "no truth")
    assert kept(small_disk) == pytest.approx(1.5 * MB, abs=STEP_BYTES)
    log.write_bytes(bytes(2 * MB))
    reserve.follow(log)
    log.unlink()
    reserve.take()
    assert kept(small_disk) == 5 * MB, "two and a half times the largest trial"


def test_a_reserve_gives_way_when_others_would_end_for_it(small_disk):
    reserve = Reserve(small_disk, 4 * MB, print, left_bytes=2 * MB)
    reserve.take()
    assert reserve.lacks is None
    (small_disk / "ballast").write_bytes(bytes(3 * MB + MB // 2))
    reserve.take()
    assert reserve.lacks is not None and kept(small_disk) == 0
    (small_disk / "ballast").unlink()
    reserve.take()
    assert reserve.lacks is None


def test_what_a_killed_robot_left_is_given_back(tmp_path):
    (tmp_path / NAME).write_bytes(bytes(MB))
    Reserve(tmp_path, 0, print).take()
    assert not (tmp_path / NAME).exists()
