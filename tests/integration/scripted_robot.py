"""A robot that speaks the whole lease protocol but moves nothing: ``python scripted_robot.py NAME --api … [--bus …]``.

It is the smallest partner the services can have; outcomes depend on the trial's seed alone. Without ``--bus`` it comes onto
the bus as real robots do, with what the API gives it for its token.
"""

import argparse
import hashlib
import os
import queue
import random
import signal
import ssl
import threading
import time
import uuid
from pathlib import Path

import httpx
import zenoh

from api_schemas import bus
from api_schemas.robot import Lease, OfferReply, OutcomeReport, Renewal, RobotHealth, RobotState, SelfTest
from api_schemas.trial import FAULT_OF, Measures, Outcome, OutcomeKind, PolicyTiming

HEALTH = RobotHealth(
    motor_temperature_rise_k=12.3, tracker_confidence=0.91, self_test=SelfTest(at="2026-01-01T00:00:00+00:00", wrong=None)
)


def admitted(api, token, name, ca):
    """The session that the API gives a robot for its own token."""
    from robot_farm.link.api_link import ApiLink  # not for the many that are told the bus: it takes them a second
    from robot_farm.link.bus_access import ask_access
    from robot_farm.settings import parse

    os.environ["TRIFARM_ROBOT_TOKEN"] = token
    told = parse(["--api", api, "--robot", name, *(["--ca", str(ca)] if ca else [])])
    with ApiLink(api, token, ca=ca) as link:
        return ask_access(link, name, told).session_config()


def measured(kind):
    """What a scripted robot says that it measured, and how long the policy took."""
    measures = Measures(
        success_at_end=kind == OutcomeKind.SUCCEEDED,
        success_ever=True,
        success_fraction=0.5,
        final_position_error_m=0.01,
        final_angle_error_rad=None,
        episode_return=100.0,
        control_steps=750,
        simulated_s=15.0,
    )
    timing = PolicyTiming(mean_ms=0.1, p99_ms=0.2, max_ms=0.5, allowed_ms=11.0, missed=0)
    return {"measures": measures, "policy_timing": timing}


class ScriptedRobot:
    """One session, one HTTP client, one trial at a time."""

    def __init__(
        self, name, api, endpoint, token, *, trial_s=0.05, log_bytes=1000, farm="farm", renew_s=3.0, refuse=False, fail=False,
        truth=False, breaks=None, live=False, falls_asleep=False,
    ):  # fmt: skip
        self.name, self.farm, self.trial_s, self.renew_s = name, farm, trial_s, renew_s
        self.refuse, self.fail, self.instance = refuse, fail, uuid.uuid4().hex
        self.truth, self.breaks, self.out_of_service, self.live = truth, breaks, None, live
        self.falls_asleep = falls_asleep
        self.body = random.Random(name).randbytes(log_bytes)
        self.state, self.lease, self.draining = RobotState.IDLE, None, False
        self.work, self.cancel, self.stopping = queue.SimpleQueue(), threading.Event(), threading.Event()
        ca = Path(os.environ["TRIFARM_CA"]) if "TRIFARM_CA" in os.environ else None
        verify = True if ca is None else ssl.create_default_context(cafile=ca)
        self.http = httpx.Client(base_url=api, headers={"Authorization": f"Bearer {token}"}, timeout=30, verify=verify)
        joined = self.http.post(f"/v1/robots/{name}/token")
        assert joined.status_code == 200, joined.text
        self.http.headers["Authorization"] = f"Bearer {joined.json()['secret']}"
        config = bus.session_config_json(mode="client", connect=[endpoint]) if endpoint else None
        self.session = zenoh.open(zenoh.Config.from_json5(config or admitted(api, joined.json()["secret"], name, ca)))
        self.offers = self.session.declare_queryable(bus.offer_key(farm, name), self.offered)
        self.commands = self.session.declare_queryable(bus.command_key(farm, name), self.commanded)
        self.token = self.session.liveliness().declare_token(bus.alive_key(farm, name))
        self.beat()

    def beat(self):
        lease = self.lease
        state = RobotState.DRAINING if self.draining else self.state
        state = RobotState.OUT_OF_SERVICE if self.out_of_service else state
        said = bus.Heartbeat(
            robot=self.name,
            instance=self.instance,
            pid=os.getpid(),
            host="test",
            state=state,
            trial_id=lease.trial_id if lease else None,
            fence=lease.fence if lease else None,
            reason=self.out_of_service,
            health=HEALTH,
        )
        self.session.put(bus.heartbeat_key(self.farm, self.name), said.model_dump_json())

    def reply(self, query, accepted, reason=None):
        query.reply(str(query.key_expr), OfferReply(accepted=accepted, reason=reason).model_dump_json())

    def offered(self, query):
        lease = Lease.model_validate_json(query.payload.to_bytes())
        if self.refuse or self.draining or self.out_of_service or self.lease is not None:
            self.reply(query, False, "busy" if self.lease else "not now")
            return
        self.lease, self.state = lease, RobotState.LEASED
        self.cancel.clear()
        self.reply(query, True)
        self.work.put(lease)

    def commanded(self, query):
        command = bus.Command.model_validate_json(query.payload.to_bytes())
        if command.kind == bus.CommandKind.CANCEL and self.lease and command.trial_id == self.lease.trial_id:
            self.cancel.set()
        elif command.kind != bus.CommandKind.CANCEL:
            self.draining = command.kind == bus.CommandKind.DRAIN
            if command.kind == bus.CommandKind.RESUME:
                self.out_of_service = None  # its self-test finds nothing any more
            self.beat()
        self.reply(query, True)

    def run(self):
        """Heartbeats once a second, trials in between."""
        while not self.stopping.is_set():
            try:
                lease = self.work.get(timeout=bus.HEARTBEAT_EVERY_S)
            except queue.Empty:
                self.beat()
                continue
            if lease is not None:
                self.trial(lease)

    def stop(self):
        """Ends ``run`` at once; a trial that runs is left."""
        self.stopping.set()
        self.work.put(None)

    def trial(self, lease):
        self.state = RobotState.RUNNING
        self.beat()
        kind = self.wait_out(lease)
        if kind is not None:
            truth_sha256 = self.upload(lease, "truth", lease.model_dump_json().encode()) if self.truth else None
            log_sha256 = self.upload(lease, "log", lease.seed.to_bytes(8) + self.body)
            self.lease, self.state = None, RobotState.IDLE
            if log_sha256 is not None:
                self.post_outcome(lease, kind, log_sha256, truth_sha256)
        self.lease, self.state = None, RobotState.IDLE
        self.beat()

    def wait_out(self, lease):
        ends = time.monotonic() + self.trial_s
        renew_at = beat_at = time.monotonic() + min(self.renew_s, 1.0)
        if self.falls_asleep:
            self.falls_asleep = False
            os.kill(os.getpid(), signal.SIGSTOP)
        while (left := ends - time.monotonic()) > 0:
            if self.cancel.wait(min(left, 0.1 if self.live else 0.2)):
                return OutcomeKind.CANCELLED
            if self.stopping.is_set():
                return None
            if self.live:
                self.show(lease, self.trial_s - left)
            if time.monotonic() >= beat_at:
                self.beat()
                beat_at += 1
            if time.monotonic() >= renew_at:
                renew_at += self.renew_s
                renewal = Renewal(robot=self.name, fence=lease.fence)
                answer = self.send("POST", f"/v1/leases/{lease.trial_id}/renew", json=renewal.model_dump())
                if answer.status_code == 409:
                    return None
                if answer.is_success and answer.json()["cancel"]:
                    return OutcomeKind.CANCELLED
        return self.scripted(lease)

    def show(self, lease, simulated_s):
        """What a real robot shows ten times a second."""
        state = bus.LiveState(
            robot=self.name, trial_id=lease.trial_id, fence=lease.fence, simulated_s=simulated_s, duration_s=self.trial_s,
            joint_position_rad=(0.0, 0.9, -1.7) * 3, tracked_cube_position_world_m=(0.0, 0.0, 0.0325),
            tracked_cube_quat_wxyz=(1.0, 0.0, 0.0, 0.0), goal=(0.05, 0.0, 0.0325, 1.0, 0.0, 0.0, 0.0),
        )  # fmt: skip
        self.session.put(bus.live_key(self.farm, self.name), state.model_dump_json())

    def scripted(self, lease):
        """How a trial ends that nothing cut short."""
        if self.breaks is not None:
            self.out_of_service, self.breaks = self.breaks, None
            return OutcomeKind.PLATFORM_ERROR
        if self.fail:
            return OutcomeKind.PLATFORM_ERROR
        if lease.excitation is not None:
            return OutcomeKind.RECORDED
        return OutcomeKind.SUCCEEDED if lease.seed % 4 else OutcomeKind.FAILED

    def upload(self, lease, what, body):
        sha256 = hashlib.sha256(body).hexdigest()
        path = f"/v1/leases/{lease.trial_id}/{lease.fence}/{what}"
        answer = self.send("PUT", path, content=body, headers={"X-Content-SHA256": sha256})
        return sha256 if answer.is_success else None

    def post_outcome(self, lease, kind, log_sha256, truth_sha256):
        outcome = Outcome(kind=kind, fault=FAULT_OF[kind], reason=f"scripted {kind}")
        if lease.excitation is None:
            outcome = outcome.model_copy(update=measured(kind))
        report = OutcomeReport(
            robot=self.name, fence=lease.fence, outcome=outcome, log_sha256=log_sha256, truth_sha256=truth_sha256
        )
        return self.send("POST", f"/v1/leases/{lease.trial_id}/outcome", content=report.model_dump_json())

    def send(self, method, path, **content):
        """A request that outlives a restart of the services."""
        while not self.stopping.is_set():
            try:
                return self.http.request(method, path, **content)
            except httpx.TransportError:
                time.sleep(0.2)
        raise SystemExit

    def close(self):
        self.stopping.set()
        for each in (self.offers, self.commands, self.token):
            each.undeclare()
        self.session.close()
        self.http.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("name")
    parser.add_argument("--api", required=True)
    parser.add_argument("--bus")
    parser.add_argument("--trial-s", type=float, default=0.05)
    parser.add_argument("--log-bytes", type=int, default=1000)
    parser.add_argument("--renew-s", type=float, default=3.0)
    parser.add_argument("--refuse", action="store_true")
    parser.add_argument("--fail", action="store_true")
    parser.add_argument("--truth", action="store_true", help="upload a truth beside each log: the lease itself")
    parser.add_argument("--live", action="store_true", help="show itself while a trial runs")
    parser.add_argument("--falls-asleep", action="store_true", help="stop in the middle of the first trial, until it is woken")
    parser.add_argument("--breaks", help="go out of service for this reason in the first trial, until told to resume")
    given = parser.parse_args()
    robot = ScriptedRobot(
        given.name,
        given.api,
        given.bus,
        os.environ["TRIFARM_ROBOT_TOKEN"],
        trial_s=given.trial_s,
        log_bytes=given.log_bytes,
        renew_s=given.renew_s,
        refuse=given.refuse,
        fail=given.fail,
        truth=given.truth,
        breaks=given.breaks,
        live=given.live,
        falls_asleep=given.falls_asleep,
    )
    signal.signal(signal.SIGTERM, lambda *_: robot.stop())
    try:
        robot.run()
    finally:
        robot.close()


if __name__ == "__main__":
    main()
