"""The file of a policy's graph is gone: its jobs say so, and no robot is blamed for leases that it could not use."""

from tests.integration.farm_process import PATIENCE_S, services, small_policy, until


def test_a_job_whose_graph_is_gone_fails_at_once_and_can_go_on_when_it_is_back(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robot("robot-0", trial_s=600)
        weights = small_policy(seed=3)
        policy = farm.upload(*weights).json()
        job_ids = [farm.submit(policy["digest"], trials=3).json()["job_id"] for _ in range(2)]
        until(lambda: farm.job(job_ids[0])["trials_running"] == 1, PATIENCE_S, "a trial to run")
        graph = farm.data / "files" / "sha256" / policy["graph_sha256"][:2] / policy["graph_sha256"]
        graph.unlink()
        assert farm.robot_client("robot-0").get(f"/v1/policies/{policy['digest']}/graph").status_code == 404
        for job_id in job_ids:
            ended = farm.wait_for_end(job_id)
            assert ended["state"] == "failed" and "graph is gone from the farm" in ended["reason"]
        until(lambda: farm.robots_in("idle") == 1, PATIENCE_S, "the robot to stop")
        assert farm.upload(*weights).status_code == 200 and graph.exists()
        again = farm.admin.post(f"/v1/jobs/{job_ids[1]}/requeue")
        assert again.status_code == 200, again.text
        until(lambda: farm.job(job_ids[1])["trials_running"] == 1, PATIENCE_S, "the job to go on")
