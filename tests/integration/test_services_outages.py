"""The API is out of a real robot's reach while bus and dispatcher live: nothing is withdrawn, nothing fails."""

import os
import socket
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing, contextmanager, suppress

from tests.integration.farm_process import PATIENCE_S, ROOT, services, until

LEASE_S = 8.0
"""More than a machine stalls for: of a lease that ends before the way is cut the robot would be blamed."""


class Way:
    """Carries the robot's connections to the API on loopback, until it is cut."""

    def __init__(self, port):
        self._port, self._open, self._is_cut = port, [], False
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self):
        self._is_cut = True
        for each in self._open:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def mend(self):
        self._is_cut = False

    def close(self):
        self._listening.close()
        self.cut()

    def _accept(self):
        with suppress(OSError):
            while True:
                robot, _ = self._listening.accept()
                if self._is_cut:
                    robot.close()
                    continue
                api = socket.create_connection(("127.0.0.1", self._port))
                self._open += [robot, api]
                for one, other in ((robot, api), (api, robot)):
                    threading.Thread(target=self._carry, args=(one, other), daemon=True).start()

    def _carry(self, one, other):
        with one, suppress(OSError):
            while data := one.recv(65_536):
                other.sendall(data)
        with suppress(OSError):
            other.shutdown(socket.SHUT_WR)


@contextmanager
def real_robot(farm, way, folder):
    command = [sys.executable, "-m", "robot_farm", "--robot", "robot-0", "--api", way.url, "--bus", farm.bus, "--farm", "farm"]
    told = [*command, "--physics", "nominal", "--data", str(folder)]
    with (folder.parent / "robot.txt").open("w") as said:
        environment = os.environ | {"TRIFARM_ROBOT_TOKEN": farm.tokens["robot"]}
        process = subprocess.Popen(told, cwd=ROOT, env=environment, stdout=said, stderr=said)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def counted(farm):
    with closing(sqlite3.connect(farm.data / "farm.sqlite")) as connection:
        (faults,) = connection.execute("SELECT faults FROM trial").fetchone()
        (in_a_row,) = connection.execute("SELECT faults_in_a_row FROM robot").fetchone()
    return faults, in_a_row


def test_an_outage_of_the_way_to_the_api_costs_neither_the_robot_nor_the_job(tmp_path):
    with (
        services(tmp_path / "farm", lease_s=LEASE_S, max_attempts=1) as farm,
        closing(Way(farm.port)) as way,
        real_robot(farm, way, tmp_path / "robots") as robot,
    ):
        until(lambda: farm.robots_in("idle") == 1, PATIENCE_S, "the robot to come")
        job_id = farm.identify(excitations=["slow_ramps"]).json()["job_id"]
        until(lambda: farm.robots_in("running") == 1, PATIENCE_S, "the trial to run")
        way.cut()
        until(lambda: farm.job(job_id)["trials_running"] == 0, PATIENCE_S, "the lease to end")
        until(lambda: farm.robots_in("out_of_service") == 1, PATIENCE_S, "the robot to take no offers")
        said = farm.admin.get("/v1/robots/robot-0").json()
        assert "the API does not answer" in said["reason"]
        assert (farm.job(job_id)["state"], counted(farm)) == ("running", (0, 0))
        way.mend()
        assert farm.wait_for_end(job_id)["state"] == "succeeded", farm.job(job_id)
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert report["platform_faults"] >= 1, "the attempt is in the report"
        assert all("the API did not answer it" in each["reason"] for each in report["platform_fault_attempts"])
        assert counted(farm) == (0, 0)
        again = farm.identify(excitations=["slow_ramps"]).json()["job_id"]
        until(lambda: farm.robots_in("running") == 1, PATIENCE_S, "the next trial to run")
        robot.kill()
        assert farm.wait_for_end(again)["state"] == "failed", "one that is killed counts"
