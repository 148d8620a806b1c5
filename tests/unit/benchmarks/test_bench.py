"""The table of ``make bench``."""

from tests.benchmarks.bench import FIGURES, table
from tests.benchmarks.machine import cores, cpu_model, kind


def test_a_figure_stands_beside_what_is_wanted_and_what_was_kept():
    header, ratio, held = table({"full_real_ratio": 0.5, "bare_held_us": 11.0}, {"bare_held_us": 10.0}).splitlines()
    assert header.split() == ["now", "wanted", "kept", "change"]
    assert ratio.split()[-6:] == ["0.50", ">=", "0.55", "not", "as", "wanted"]
    assert held.split()[-3:] == ["11.00", "10.00", "+10%"]


def test_every_figure_can_be_shown():
    lines = table(dict.fromkeys(FIGURES, 1.0), dict.fromkeys(FIGURES, 2.0)).splitlines()[1:]
    assert len(lines) == len(FIGURES)
    assert all("-50%" in line for line in lines)


def test_the_kind_of_a_machine_can_name_a_file():
    assert kind().replace("-", "").isalnum()
    assert kind().endswith(f"-{cores()}-cores")
    assert cpu_model()
