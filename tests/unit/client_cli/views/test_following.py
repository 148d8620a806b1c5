import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from api_schemas.job import JobState
from client_cli.views import following
from tests.unit.client_cli.farm_server import JOB_ID, event

RUN = [event(1, "job_queued"), event(2, "trial_leased", ordinal=0), event(3, "trial_done", ordinal=0, done=1)]
END = event(4, "job_ended", done=3, state=JobState.SUCCEEDED)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(following, "RECONNECT_EVERY_S", 0.05)


def test_watch_follows_to_the_report(farm, trifarm):
    farm.state, farm.streams = JobState.RUNNING, [[*RUN, None, END]]
    ended = trifarm("watch", JOB_ID)
    assert ended.code == 0
    told, _, address = ended.out.strip().rpartition("; ")
    assert told == f"job {JOB_ID}: 2 of 3 trials succeeded, 67 %, 95 % interval 21–94 %; 'trifarm report {JOB_ID}' shows them"
    assert address.startswith("http") and address.endswith(f"/jobs/{JOB_ID}")
    assert "waiting: no robot is in service" in ended.err
    assert "1/3 done" in ended.err


def test_a_cut_stream_goes_on_after_the_last_event(farm, trifarm):
    farm.state, farm.streams = JobState.RUNNING, [RUN, [], [END]]
    assert trifarm("watch", JOB_ID, "--json").document["state"] == "succeeded"
    assert farm.last_event_ids == [None, "3", "3"]


def test_a_job_that_was_queued_again_is_followed_to_its_end(farm, trifarm):
    stopped = event(2, "trial_cancelled", ordinal=1, state=JobState.FAILED)  # after the job had failed, and before it went on
    again = event(3, "job_queued_again", state=JobState.RUNNING)
    farm.state, farm.streams = JobState.RUNNING, [[RUN[0], stopped, again], [END]]
    assert trifarm("watch", JOB_ID).code == 0
    assert farm.last_event_ids == [None, "3"]


def test_a_stream_that_others_of_the_owner_keep_out_is_asked_for_again(farm, trifarm):
    farm.state, farm.streams, farm.busy = JobState.RUNNING, [[*RUN, END]], {"event-readers": 2}
    ended = trifarm("watch", JOB_ID)
    assert ended.code == 0
    assert ended.err.count("trying again for 60 s: others are under way") == 1
    assert "connection lost" not in ended.err


def test_an_ended_job_needs_no_stream(farm, trifarm):
    farm.state = JobState.FAILED
    ended = trifarm("watch", JOB_ID)
    assert ended.code == 3
    assert "failed: robot-1 vanished 5 times" in ended.out
    assert not farm.last_event_ids


def test_a_server_that_stays_away_ends_the_watching(farm, trifarm, monkeypatch):
    waited_s = [0.0]
    monkeypatch.setattr(following, "time", SimpleNamespace(monotonic=lambda: sum(waited_s), sleep=waited_s.append))
    monkeypatch.setattr(following, "RECONNECT_EVERY_S", following.GIVE_UP_AFTER_S / 8)
    farm.state, farm.streams = JobState.RUNNING, [RUN]
    original = following.ApiClient.events

    def unreachable(client, job_id, after):
        if after is None:
            yield from original(client, job_id, after)
            return
        raise following.ServerAway(client.url, "refused")

    monkeypatch.setattr(following.ApiClient, "events", unreachable)
    ended = trifarm("watch", JOB_ID)
    assert ended.code == 4
    assert ended.err.count("connection lost, trying again") == 1
    assert following.GIVE_UP_AFTER_S < sum(waited_s) < 1.5 * following.GIVE_UP_AFTER_S


def test_ctrl_c_leaves_the_job_running(farm):
    farm.state, farm.streams, farm.hang_stream = JobState.RUNNING, [RUN], True
    with subprocess.Popen([sys.executable, "-m", "client_cli", "watch", JOB_ID], env=os.environ, stderr=subprocess.PIPE) as watch:
        while not farm.last_event_ids:
            time.sleep(0.05)
        time.sleep(0.3)
        watch.send_signal(signal.SIGINT)
        _, text = watch.communicate(timeout=120)
    assert watch.returncode == 130
    assert f"job {JOB_ID} goes on without you" in text.decode()
    assert farm.state is JobState.RUNNING
