"""The health check of a dispatcher's container passes while its loop goes round and fails when it stands still."""

import os
import signal
import subprocess
import sys

import yaml

from tests.integration.farm_process import PATIENCE_S, ROOT, is_stopped, services, until


def test_the_check_of_the_compose_file_sees_a_loop_that_stands_still(tmp_path):
    alive = tmp_path / "alive"
    program = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]["dispatcher"]["healthcheck"]["test"]
    check = [sys.executable, "-c", program[-1].replace("/tmp/alive", str(alive))]

    def passes():
        return subprocess.run(check, check=False, capture_output=True).returncode == 0

    assert not passes(), "nothing runs yet"
    with services(tmp_path / "farm", alive_file=alive) as farm:
        until(passes, PATIENCE_S, "a sign of life")
        farm.process.send_signal(signal.SIGSTOP)
        until(lambda: is_stopped(farm.process), PATIENCE_S, "the services to stand still")
        os.utime(alive, (0, 0))  # as if it had stood still for long
        assert not passes()
        farm.process.send_signal(signal.SIGCONT)
        until(passes, PATIENCE_S, "another sign of life")


def test_a_sign_of_life_that_cannot_be_written_stops_nothing(tmp_path):
    with services(tmp_path / "farm", alive_file=tmp_path / "no such folder" / "alive") as farm:
        farm.start_robot("robot-0", trial_s=0.02)
        job_id = farm.submit(farm.policy(), trials=2).json()["job_id"]
        assert farm.wait_for_end(job_id)["state"] == "succeeded"
