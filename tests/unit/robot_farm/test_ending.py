"""What is under way is finished within its time, or ended by a second signal."""

import os
import signal

import pytest

from robot_farm.process import Ending, end_by_signal
from robot_farm.settings import TOKEN_VARIABLE, parse


def test_without_time_to_finish_anything_a_first_signal_ends_all():
    ending = Ending()
    ending.begin()
    assert ending.leaving.is_set() and ending.stop.is_set()


def test_with_time_what_is_under_way_goes_on_until_that_is_over():
    patient = Ending(drain_s=600.0)
    patient.begin()
    assert patient.leaving.is_set() and not patient.stop.is_set()
    ending = Ending(drain_s=0.05)
    ending.begin()
    assert ending.leaving.is_set() and ending.stop.wait(120.0)


def test_a_second_signal_ends_it_at_once():
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        ending = end_by_signal()
        ending.drain_s = 600.0
        os.kill(os.getpid(), signal.SIGTERM)
        assert ending.leaving.wait(120.0) and not ending.stop.is_set()
        os.kill(os.getpid(), signal.SIGINT)
        assert ending.stop.wait(120.0)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "soon", "90000"])
def test_a_time_that_is_none_is_told(text, monkeypatch, capsys):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    with pytest.raises(SystemExit):
        parse(["--api", "http://127.0.0.1:1", f"--drain-s={text}"])
    assert "no number of seconds from 0 to 86400" in capsys.readouterr().err
