"""Many scripted robots in one process, for ``thousand_robots``: each with a session, a token and a lease of its own.

They come evenly within some seconds, say once a second that they are there, and take leases; a trial is ``trial_s`` of waiting,
a small log and an outcome. One thread beats for all, some others carry requests, so that the robots cost little beside what
they ask for. The first line on standard output says that all have come; SIGTERM ends them.
"""

import argparse
import hashlib
import heapq
import http.client
import itertools
import json
import os
import queue
import signal
import threading
import time
import uuid
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import zenoh

from api_schemas import bus
from api_schemas.robot import Lease, OfferReply, OutcomeReport, Renewal, RobotHealth, RobotState, SelfTest
from api_schemas.trial import FAULT_OF, Outcome, OutcomeKind
from tests.integration.scripted_robot import measured

COMING_AT_ONCE, CARRIERS, TRIES = 16, 24, 3
OPENED_WITHIN_S = 60.0
LOG_BYTES = 1000
RENEW_S = 3.0
SELF_TEST = SelfTest(at="2026-01-01T00:00:00+00:00", wrong=None)
KIND = OutcomeKind.SUCCEEDED
DONE = Outcome(kind=KIND, fault=FAULT_OF[KIND], reason="scripted", **measured(KIND))


class Carrier:
    """Requests over connections that stay open, one for each thread."""

    def __init__(self, api):
        address = urlsplit(api)
        self.host, self.port, self.own = address.hostname or "", address.port, threading.local()

    def ask(self, method, path, token, body=None):
        """Status and body; a connection that the services closed meanwhile is made anew."""
        if not hasattr(self.own, "connection"):
            self.own.connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        for _ in range(TRIES):
            try:
                self.own.connection.request(method, path, body, {"Authorization": f"Bearer {token}"})
                answer = self.own.connection.getresponse()
                return answer.status, answer.read()
            except (OSError, http.client.HTTPException):
                self.own.connection.close()
        return 0, b"no answer"


class Robot:
    """One of the swarm."""

    def __init__(self, swarm, name):
        self.swarm, self.name, self.instance = swarm, name, uuid.uuid4().hex
        self.state, self.beats = RobotState.IDLE, 0
        self.lease: Lease | None = None

    def come(self):
        """Gets a token and goes onto the bus."""
        status, answer = self.swarm.carrier.ask("POST", f"/v1/robots/{self.name}/token", self.swarm.token)
        assert status == 200, answer
        self.token = json.loads(answer)["secret"]
        config = bus.session_config_json(mode="client", connect=[self.swarm.bus])
        self.session = _opened(config)
        farm = self.swarm.farm
        self.declared = (
            self.session.declare_queryable(bus.offer_key(farm, self.name), self.offered),
            self.session.declare_queryable(bus.command_key(farm, self.name), lambda query: self.reply(query, accepted=True)),
            self.session.liveliness().declare_token(bus.alive_key(farm, self.name)),
        )
        self.heartbeats = self.session.declare_publisher(bus.heartbeat_key(farm, self.name))
        self.beat()

    def beat(self):
        """Says what it does; its temperature is another each time, as a real one's is."""
        self.beats += 1
        lease = self.lease
        said = bus.Heartbeat(
            robot=self.name,
            instance=self.instance,
            pid=os.getpid(),
            host="swarm",
            state=self.state,
            trial_id=lease.trial_id if lease else None,
            fence=lease.fence if lease else None,
            health=RobotHealth(motor_temperature_rise_k=0.1 * (self.beats % 50), tracker_confidence=0.9, self_test=SELF_TEST),
        )
        self.heartbeats.put(said.model_dump_json())

    def reply(self, query, *, accepted):
        query.reply(str(query.key_expr), OfferReply(accepted=accepted).model_dump_json())

    def offered(self, query):
        """Takes a lease if it has none, and is done with it ``trial_s`` later."""
        lease = Lease.model_validate_json(query.payload.to_bytes())
        if self.lease is not None:
            self.reply(query, accepted=self.lease == lease)
            return
        self.lease, self.state = lease, RobotState.RUNNING
        self.reply(query, accepted=True)
        self.swarm.later(self.swarm.trial_s, self.finish, lease)
        if self.swarm.trial_s > RENEW_S:
            self.swarm.later(RENEW_S, self.renew, lease)

    def renew(self, lease):
        """Holds the lease for longer, as often as real robots do."""
        if self.lease is lease:
            body = Renewal(robot=self.name, fence=lease.fence).model_dump_json()
            self.swarm.carrier.ask("POST", f"/v1/leases/{lease.trial_id}/renew", self.token, body)
            self.swarm.later(RENEW_S, self.renew, lease)

    def finish(self, lease):
        """Brings log and outcome home."""
        path, log = f"/v1/leases/{lease.trial_id}/{lease.fence}/log", lease.seed.to_bytes(8) * (LOG_BYTES // 8)
        status, answer = self.swarm.carrier.ask("PUT", path, self.token, log)
        self.lease, self.state = None, RobotState.IDLE
        if status == 200:
            sha256 = hashlib.sha256(log).hexdigest()
            report = OutcomeReport(robot=self.name, fence=lease.fence, outcome=DONE, log_sha256=sha256)
            # Without what it does not say, so that services of 0.1.0 take it, too.
            path = f"/v1/leases/{lease.trial_id}/outcome"
            status, answer = self.swarm.carrier.ask("POST", path, self.token, report.model_dump_json(exclude_defaults=True))
        if status != 200:
            self.swarm.refused[f"{status} {answer[:200].decode(errors='replace')}"[:60]] += 1


def _opened(config):
    """A session; a router to whom many come at once may let one wait, who then comes again as a real robot does."""
    gives_up_s = time.monotonic() + OPENED_WITHIN_S
    while True:
        try:
            return zenoh.open(zenoh.Config.from_json5(config))
        except zenoh.ZError:
            if time.monotonic() > gives_up_s:
                raise
            time.sleep(0.5)


class Swarm:
    """All of them, and what is due when."""

    def __init__(self, asked, token):
        self.bus, self.farm, self.token, self.trial_s = asked.bus, asked.farm, token, asked.trial_s
        self.carrier, self.refused = Carrier(asked.api), Counter()
        self.robots = [Robot(self, f"robot-{number:04d}") for number in range(asked.robots)]
        self.there, self.due, self.number = [], [], itertools.count()
        self.lock, self.work, self.closing = threading.Lock(), queue.SimpleQueue(), threading.Event()

    def later(self, after_s, call, lease):
        with self.lock:
            heapq.heappush(self.due, (time.monotonic() + after_s, next(self.number), call, lease))

    def come(self, within_s):
        """All come, evenly; gives how long it took."""
        began_s = time.monotonic()

        def one(number):
            time.sleep(max(0.0, began_s + within_s * number / len(self.robots) - time.monotonic()))
            self.robots[number].come()
            self.there.append(self.robots[number])

        with ThreadPoolExecutor(COMING_AT_ONCE) as pool:
            list(pool.map(one, range(len(self.robots))))
        return time.monotonic() - began_s

    def keep_time(self):
        """Gives out what is due."""
        while not self.closing.wait(0.01):
            with self.lock:
                while self.due and self.due[0][0] <= time.monotonic():
                    self.work.put(heapq.heappop(self.due)[2:])

    def carry(self):
        while True:
            call, lease = self.work.get()
            call(lease)

    def beat(self):
        """Each once a second, evenly."""
        while not self.closing.is_set():
            second_s, there = time.monotonic(), list(self.there)
            for number, robot in enumerate(there):
                if (wait_s := second_s + number / len(there) - time.monotonic()) > 0.005:
                    time.sleep(wait_s)
                robot.beat()
            self.closing.wait(max(0.0, second_s + 1 - time.monotonic()))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--api", required=True)
    parser.add_argument("--bus", required=True)
    parser.add_argument("--farm", default="farm")
    parser.add_argument("--within-s", type=float, default=10.0)
    parser.add_argument("--trial-s", type=float, default=1.0)
    swarm = Swarm(parser.parse_args(), os.environ["TRIFARM_ROBOT_TOKEN"])
    signal.signal(signal.SIGTERM, lambda *_: swarm.closing.set())
    for each in (swarm.beat, swarm.keep_time, *[swarm.carry] * CARRIERS):
        threading.Thread(target=each, daemon=True).start()
    took_s = swarm.come(parser.parse_args().within_s)
    print(json.dumps({"came_within_s": round(took_s, 1)}), flush=True)
    began_s, before = time.monotonic(), sum(robot.beats for robot in swarm.robots)
    swarm.closing.wait()
    beats = (sum(robot.beats for robot in swarm.robots) - before) / len(swarm.robots) / (time.monotonic() - began_s)
    refused = {"requests_refused": swarm.refused.total(), "refused_with": swarm.refused}
    print(json.dumps({"beats_per_s_of_each": round(beats, 2)} | refused), flush=True)
    os._exit(0)  # a thousand sessions take their time to close, and nobody waits for a word of theirs


if __name__ == "__main__":
    main()
