import pytest

from client_cli.embedded.robot_count import FARM_BYTES, MOST, ROBOT_BYTES, fitting, free_memory_bytes

ROOM = FARM_BYTES + 100 * ROBOT_BYTES


@pytest.mark.parametrize(
    ("cores", "free_bytes", "robots"),
    [
        (2, ROOM, 4),
        (2, None, 4),
        (16, FARM_BYTES + 5 * ROBOT_BYTES, 5),
        (2, 0, 1),
        (128, ROOM, MOST),
    ],
)
def test_two_robots_a_core_as_far_as_memory_goes(cores, free_bytes, robots):
    assert fitting(cores, free_bytes) == robots


def test_the_smaller_of_what_machine_and_control_group_have_left_counts(tmp_path):
    machine, most, used = (tmp_path / name for name in ("meminfo", "max", "current"))
    assert free_memory_bytes(machine, most, used) is None
    machine.write_text("MemTotal:       2000 kB\nMemAvailable:   1000 kB\n")
    assert free_memory_bytes(machine, most, used) == 1000 * 1024
    most.write_text("max\n")
    assert free_memory_bytes(machine, most, used) == 1000 * 1024
    most.write_text("900000\n")
    used.write_text("300000\n")
    assert free_memory_bytes(machine, most, used) == 600_000
