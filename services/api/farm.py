"""What every route works with: the parts of the running services, handed in by the composition."""

import asyncio
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, Request
from prometheus_client import CollectorRegistry

from jail.level import Jail
from services.database.database import Database
from services.disk import Disk
from services.files.store import FileStore
from services.jobs.clock import FarmClock
from services.jobs.drawn import DrawnGoals
from services.jobs.fleet import Fleet
from services.jobs.holding import Holding
from services.jobs.signals import Signals
from services.policies.keeping import Policies
from services.settings import Settings
from services.signing import FarmKey
from services.tokens import Tokens


@dataclass(frozen=True)
class Farm:
    """The parts of one services process."""

    settings: Settings
    database: Database
    files: FileStore
    policies: Policies
    holding: Holding
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    tokens: Tokens
    registry: CollectorRegistry
    version: str
    verifications: asyncio.Semaphore
    jail: Jail
    key: FarmKey
    disk: Disk
    started_at: str
    """This process, in ISO 8601."""
    goals: DrawnGoals = field(default_factory=DrawnGoals)


async def _farm(request: Request) -> Farm:
    return request.app.state.farm


TheFarm = Annotated[Farm, Depends(_farm)]
