"""A log replays bit for bit, and a forged one is found out."""

import dataclasses

import numpy as np
import pytest

from api_schemas.trial import Verification
from sim_backend.replays import replay
from sim_backend.trifinger.form import scene_form
from trial_logs.reader import LogUnreadableError, read_log


def test_true_log_gives_the_same_numbers(short_log):
    result = replay.verify(read_log(short_log))
    assert result.same
    assert result.steps == 1000


def test_a_forged_torque_is_named_by_its_step(short_log):
    log = read_log(short_log)
    torque = log.applied_torque_nm.copy()
    torque[500, 3] = torque[500, 3] + 1e-9
    result = replay.verify(dataclasses.replace(log, applied_torque_nm=torque))
    assert not result.same
    assert result.first_difference_step is not None
    assert 500 < result.first_difference_step < 520


def test_another_form_of_the_scene_is_told_apart_from_a_forged_log(short_log, capsys):
    log = read_log(short_log)
    torque = log.applied_torque_nm.copy()
    torque[500, 3] += 1e-9
    old = dataclasses.replace(log, applied_torque_nm=torque, metadata={**log.metadata, "form": "0.1.7"})
    result = Verification(**dataclasses.asdict(replay.verify(old)))
    assert not result.same and result.is_of_other_form
    said = result.in_words("old.mcap")
    assert f"is of form 0.1.7 of the scene, and this version simulates form {scene_form()}" in said
    assert "says nothing against the log" in said
    of_now = Verification(**dataclasses.asdict(replay.verify(dataclasses.replace(log, applied_torque_nm=torque))))
    assert not of_now.same and not of_now.is_of_other_form and "form" not in of_now.in_words("forged.mcap")


def test_a_truncated_log_is_refused(short_log, tmp_path, capsys):
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(short_log.read_bytes()[:-2000])
    with pytest.raises(LogUnreadableError, match=r"broken\.mcap .*its end is missing"):
        read_log(broken)
    assert replay.main([str(broken), "--verify"]) == replay.EXIT_UNREADABLE
    assert "error: broken.mcap" in capsys.readouterr().err


def test_command_says_same(short_log, capsys):
    assert replay.main([str(short_log), "--verify"]) == 0
    assert "same numbers in all 1000 steps" in capsys.readouterr().out


def test_no_damage_gives_anything_but_a_clear_refusal_or_the_log(short_log, tmp_path):
    rng, whole = np.random.default_rng(0), short_log.read_bytes()
    broken = tmp_path / "broken.mcap"
    refused = 0
    for _ in range(40):
        data = bytearray(whole[: rng.integers(1, len(whole))] if rng.random() < 0.5 else whole)
        for place in rng.integers(0, len(data), size=rng.integers(1, 5)):
            data[place] ^= 1 << rng.integers(8)
        broken.write_bytes(data)
        try:
            read_log(broken)
        except LogUnreadableError:
            refused += 1
    assert refused > 30
