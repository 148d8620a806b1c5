"""What goes wrong on a farm, done to real services: robots die, hang and come back; the services are killed."""

import signal
import sqlite3
import time

from tests.integration.farm_process import PATIENCE_S, is_stopped, services, until
from tests.integration.test_dashboard import signed_in, user_token

OUTCOME = {"kind": "failed", "fault": "none", "reason": "too late"}


def states(farm, job_id):
    return [trial["state"] for trial in farm.admin.get(f"/v1/jobs/{job_id}/trials").json()["trials"]]


def running_trial(farm, job_id, robot):
    trials = farm.admin.get(f"/v1/jobs/{job_id}/trials").json()["trials"]
    return next((trial for trial in trials if trial["state"] == "running" and trial["robot"] == robot), None)


def test_a_killed_robot_costs_one_platform_fault_and_no_trial(tmp_path):
    with services(tmp_path / "farm", renew_every_s=0.5) as farm:
        farm.start_robot("robot-0", trial_s=0.05)
        farm.start_robot("robot-1", trial_s=600)  # which is killed in the middle of it, however late
        until(lambda: farm.robots_in("idle") == 2, PATIENCE_S, "both robots")
        job_id = farm.submit(farm.policy(), trials=12).json()["job_id"]
        until(lambda: running_trial(farm, job_id, "robot-1"), PATIENCE_S, "robot-1 to run a trial")
        farm.robots["robot-1"].kill()
        assert farm.wait_for_end(job_id)["state"] == "succeeded"
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert (report["platform_faults"], report["attempts"], len(report["per_trial"])) == (1, 13, 12)
        assert "robot-1 was lost" in report["platform_fault_attempts"][0]["reason"]
        assert [row["attempts"] for row in report["per_trial"]].count(2) == 1
        robot = farm.admin.get("/v1/robots/robot-1").json()
        assert robot["state"] == "lost"
        assert not farm.admin.get("/v1/status").json()["healthy"]


def test_a_robot_that_comes_back_anew_frees_its_trial_at_once(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(1, trial_s=60)
        job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
        until(lambda: states(farm, job_id) == ["running"], PATIENCE_S, "the trial to run")
        farm.robots["robot-0"].kill()
        farm.start_robot("robot-0", trial_s=0.1)
        farm.wait_for_end(job_id)
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert report["platform_fault_attempts"][0]["reason"] == "robot-0 restarted while it held the lease"
        seen = signed_in(farm, farm.tokens["admin"]).get("/").text
        for words in ("1 incident, the last just now", "robot-0 restarted while it held the lease", f"/trials/{job_id}-000"):
            assert words in seen
        by_bob = signed_in(farm, user_token(farm, "bob")["secret"]).get("/").text
        assert "services up since" in by_bob and "incident" not in by_bob and job_id not in by_bob


def test_a_stopped_robot_loses_its_lease_and_is_refused_when_it_wakes(tmp_path):
    with services(tmp_path / "farm", lease_s=2, renew_every_s=0.3) as farm:
        sleeper = farm.start_robot("robot-0", trial_s=0.1, falls_asleep=True)
        until(lambda: farm.robots_in("idle") == 1, PATIENCE_S, "robot-0")
        job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
        until(lambda: is_stopped(sleeper), PATIENCE_S, "robot-0 to fall asleep in its trial")
        farm.start_robot("robot-1", trial_s=0.1)
        farm.wait_for_end(job_id)
        assert "stale-fence" not in farm.errors.read_text()
        sleeper.send_signal(signal.SIGCONT)
        until(lambda: "stale-fence" in farm.errors.read_text(), PATIENCE_S, "robot-0 to be refused")
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert report["per_trial"][0]["robot"] == "robot-1"
        assert "robot-0" in {each["robot"] for each in report["platform_fault_attempts"]}
        assert states(farm, job_id) == ["done"]


def test_a_stale_fence_is_refused_everywhere(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(1, trial_s=0.05)
        job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
        farm.wait_for_end(job_id)
        robot, trial_id = farm.robot_client("robot-0"), f"{job_id}-000"
        trial = farm.admin.get(f"/v1/trials/{trial_id}").json()
        answers = [
            robot.post(f"/v1/leases/{trial_id}/renew", json={"robot": "robot-0", "fence": 1}),
            robot.put(f"/v1/leases/{trial_id}/1/log", content=b"late"),
            robot.post(f"/v1/leases/{trial_id}/outcome", json={"robot": "robot-0", "fence": 1, "outcome": OUTCOME}),
            robot.post(f"/v1/leases/{trial_id}/outcome", json={"robot": "robot-0", "fence": 7, "outcome": OUTCOME}),
        ]
        for answer in answers:
            assert (answer.status_code, answer.json()["type"]) == (409, "/problems/stale-fence")
        same = {"robot": "robot-0", "fence": 1, "outcome": trial["outcome"], "log_sha256": trial["log_sha256"]}
        assert robot.post(f"/v1/leases/{trial_id}/outcome", json=same).status_code == 200
        assert farm.admin.get(f"/v1/trials/{trial_id}").json() == trial
        missing = robot.post("/v1/leases/jaaaaaaaaaaaa-000/renew", json={"robot": "robot-0", "fence": 1})
        assert missing.status_code == 404


def test_cancel_stops_queued_trials_at_once_and_running_ones_soon(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(2, trial_s=60)
        job_id = farm.submit(farm.policy(), trials=6).json()["job_id"]
        until(lambda: states(farm, job_id).count("running") == 2, PATIENCE_S, "two trials to run")
        answer = farm.admin.post(f"/v1/jobs/{job_id}/cancel")
        assert answer.status_code == 200
        assert states(farm, job_id).count("cancelled") >= 4
        assert farm.wait_for_end(job_id)["state"] == "cancelled"
        assert farm.admin.post(f"/v1/jobs/{job_id}/cancel").status_code == 200
        assert farm.admin.get(f"/v1/jobs/{job_id}/report").json()["type"] == "/problems/report-not-ready"
        until(lambda: farm.robots_in("idle") == 2, PATIENCE_S, "the robots to be idle")
        after = farm.submit(farm.policy(), trials=2).json()["job_id"]
        until(lambda: farm.job(after)["trials_running"] == 2, PATIENCE_S, "the next job to run")


def test_a_trial_that_always_fails_by_the_platform_fails_its_job(tmp_path):
    with services(tmp_path / "farm", max_attempts=3) as farm:
        farm.start_robots(1, trial_s=0.02, fail=True)
        job_id = farm.submit(farm.policy(), trials=3).json()["job_id"]
        job = farm.wait_for_end(job_id)
        assert job["state"] == "failed"
        assert "3 platform errors" in job["reason"]
        assert job["waiting_because"] is None
        assert farm.admin.post(f"/v1/jobs/{job_id}/cancel").status_code == 409


def test_an_outcome_names_the_log_that_was_uploaded_under_its_lease_also_before_a_restart(tmp_path):
    with services(tmp_path / "farm", lease_s=600) as farm:
        farm.start_robots(2, trial_s=60, renew_s=60)
        policy = farm.policy()
        job_id = farm.submit(policy, trials=2).json()["job_id"]
        until(lambda: states(farm, job_id) == ["running"] * 2, PATIENCE_S, "both trials to run")
        trials = farm.admin.get(f"/v1/jobs/{job_id}/trials").json()["trials"]
        mine, other = (trial["trial_id"] for trial in trials)
        robot, neighbour = (farm.robot_client(trial["robot"]) for trial in trials)

        def report(log_sha256, kind="failed"):
            body = {"robot": trials[0]["robot"], "fence": 1, "outcome": OUTCOME | {"kind": kind}, "log_sha256": log_sha256}
            return robot.post(f"/v1/leases/{mine}/outcome", json=body)

        foreign = neighbour.put(f"/v1/leases/{other}/1/log", content=b"the log of another trial").json()["sha256"]
        weights = farm.admin.get(f"/v1/policies/{policy}").json()["weights_sha256"]
        for wrong in (None, foreign, weights, "0" * 64):
            answer = report(wrong)
            assert (answer.status_code, answer.json()["type"]) == (422, "/problems/log-missing"), wrong
        log_sha256 = robot.put(f"/v1/leases/{mine}/1/log", content=b"my log").json()["sha256"]
        farm.process.kill()
        farm.process.wait()
        farm.start()
        for wrong in (None, foreign):
            assert report(wrong, kind="succeeded").json()["type"] == "/problems/log-missing"
        assert [report(log_sha256).status_code for _ in range(2)] == [200, 200]
        trial = farm.admin.get(f"/v1/trials/{mine}").json()
        assert (trial["log_sha256"], trial["log_bytes"]) == (log_sha256, 6)


def test_robots_keep_their_trials_when_the_services_are_killed_and_come_back(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(2, trial_s=2, renew_s=30)
        job_id = farm.submit(farm.policy(), trials=4).json()["job_id"]
        until(lambda: states(farm, job_id).count("running") == 2, PATIENCE_S, "two trials to run")
        farm.process.kill()
        farm.process.wait()
        farm.start()
        assert farm.wait_for_end(job_id)["state"] == "succeeded"
        with sqlite3.connect(farm.data / "farm.sqlite") as connection:
            assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            accepted = connection.execute("SELECT count(*) FROM attempt WHERE state = 'accepted'").fetchone()[0]
        connection.close()
        assert accepted == 4


def test_nonsense_on_the_bus_changes_nothing(tmp_path):
    import zenoh

    from api_schemas import bus

    with services(tmp_path / "farm") as farm:
        config = zenoh.Config.from_json5(bus.session_config_json(mode="client", connect=[farm.bus]))
        with zenoh.open(config) as session:
            for message in (b"", b"{}", b"\xff\xfe", b'{"robot":"other","instance":"x"}'):
                session.put(bus.heartbeat_key("farm", "robot-9"), message)
                time.sleep(0.3)
                assert farm.admin.get("/v1/robots").json()["robots"] == [], message
                assert farm.process.poll() is None, message
