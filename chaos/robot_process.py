"""``python -m chaos robot NAME``: one robot whose driver moves nothing."""

import argparse
import os
import signal
import threading
from pathlib import Path

from chaos.robot import RobotSettings, live
from trial_logs.disk import lose_words_rather_than_end


def main(arguments: list[str]) -> None:
    """Runs until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m chaos robot")
    parser.add_argument("name")
    parser.add_argument("--api", required=True)
    parser.add_argument("--bus", required=True)
    parser.add_argument("--farm", default="farm")
    parser.add_argument("--evidence", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--trial-s", type=float, default=0.06)
    parser.add_argument("--log-bytes", type=int, default=1000)
    given = parser.parse_args(arguments)
    lose_words_rather_than_end()
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    live(RobotSettings(**vars(given), token=os.environ["TRIFARM_ROBOT_TOKEN"]), stop)
