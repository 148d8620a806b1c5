"""The services of a farm that is broken on purpose: the real program, with a history, orders to die, and protections to lift.

Only this entry can do that: the services know neither of these. ``TRIFARM_CHAOS_WITHOUT`` names a protection that is lifted, so
that the checker can be seen to find what then goes wrong:

- ``fence``: an outcome under an older fence, of whichever robot, counts like one under the newest;
- ``key``: the Idempotency-Key of a submission is not looked at;
- ``expiry``: a lease without renewal does not end.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from sqlalchemy import Integer, bindparam, update

from chaos.history import History, Writes
from chaos.orders import Orders
from services.__main__ import main as services_main
from services.api import jobs as job_routes
from services.database.tables import attempt, trial
from services.dispatcher.dispatcher import Dispatcher
from services.dispatcher.giving import Giver
from services.dispatcher.overdue import LeaseEnder
from services.jobs import completion, lease, submission
from services.jobs.holding import Holding

EVIDENCE, NAME, WITHOUT = "TRIFARM_CHAOS_EVIDENCE", "TRIFARM_CHAOS_NAME", "TRIFARM_CHAOS_WITHOUT"


def main() -> None:
    """Runs ``python -m services`` with the arguments that follow."""
    evidence, name = Path(os.environ[EVIDENCE]), os.environ[NAME]
    history = History(evidence, name)
    history("started", pid=os.getpid(), arguments=sys.argv[1:])
    keep_history(history)
    obey(Orders(evidence))
    if without := os.environ.get(WITHOUT):
        LIFT[without]()
        history("lifted", protection=without)
    services_main()


def keep_history(history: Writes) -> None:
    """Has the dispatcher's leases and every outcome that is taken written down."""
    given, accept, end = Giver._given, Holding.accept, LeaseEnder.end

    def giving(self: Giver, claim: Any, row: Any) -> None:
        history("leased", trial=claim.trial_id, fence=claim.fence, robot=claim.robot)
        given(self, claim, row)

    async def accepting(self: Holding, reported: Any) -> Any:
        ending, report = await accept(self, reported), reported.report
        history("took", trial=reported.trial_id, fence=report.fence, robot=report.robot, again=ending.job_id is None)
        return ending

    async def ending_it(self: LeaseEnder, claim: Any, reason: str, *, never_offered: bool = False) -> None:
        history("ended", trial=claim.trial_id, fence=claim.fence, robot=claim.robot, because=reason)
        await end(self, claim, reason, never_offered=never_offered)

    Giver._given, Holding.accept, LeaseEnder.end = giving, accepting, ending_it


def obey(orders: Orders) -> None:
    """Makes the places where the process can be told to die: each between two steps that belong together."""
    offer, show_queued, keep_file = Dispatcher._offer, job_routes.show_queued, lease.keep_file

    async def offering(self: Dispatcher, claim: Any, row: Any) -> None:
        orders.die_here("before-offer")  # the lease is written, the robot does not know of it
        await offer(self, claim, row)

    async def answering(*given: Any) -> Any:
        orders.die_here("before-answer")  # the job is written, its sender does not know of it
        return await show_queued(*given)

    async def keeping(*given: Any) -> None:
        orders.die_here("before-row")  # the log is stored, no row knows of it
        await keep_file(*given)

    Dispatcher._offer, job_routes.show_queued, lease.keep_file = offering, answering, keeping  # pyrefly: ignore[bad-assignment] - whatever they are given


def without_fence() -> None:
    """Lets outcomes count under any fence, of any robot, in any state of the trial."""
    held = (trial.c.trial_id == bindparam("of_trial"), trial.c.fence >= bindparam("held_fence"))
    values = {name: bindparam(f"to_{name}") for name in ("state", "robot", "outcome", "log_sha256", "log_bytes", "truth_sha256")}
    values |= {"lease_until_s": None, "faults": trial.c.faults + bindparam("add_faults", type_=Integer)}
    moved = update(trial).where(*held, trial.c.trial_id != bindparam("held_by")).values(**values)
    completion._LEAVE = moved.returning(trial.c.job_number, trial.c.ordinal, trial.c.faults)
    this = (attempt.c.trial_id == bindparam("of_trial"), attempt.c.fence == bindparam("held_fence"))
    closed = {name: bindparam(f"to_{name}") for name in ("state", "reason", "outcome", "log_sha256", "truth_sha256")}
    lease._CLOSE_ATTEMPT = update(attempt).where(*this).values(ended_at=bindparam("at"), **closed)


def without_key() -> None:
    """Makes a new job of every submission."""
    submit = submission.submit

    async def submitting(tx: Any, now_s: float, request: Any, sender: Any, **more: Any) -> Any:
        return await submit(tx, now_s, request, replace(sender, idempotency_key=None), **more)

    submission.submit = submitting


def without_expiry() -> None:
    """Lets every lease go on for ever."""

    def never(self: LeaseEnder, row: Any, now_s: float) -> None:  # noqa: ARG001  the place of another
        return None

    LeaseEnder.why_overdue = never


LIFT: dict[str, Callable[[], None]] = {"fence": without_fence, "key": without_key, "expiry": without_expiry}
