"""What Prometheus reads: counters of this process, and what the database says of the whole farm."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from fastapi import APIRouter, Response
from fastapi.responses import PlainTextResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, generate_latest
from prometheus_client.core import CounterMetricFamily

from api_schemas.trial import Fault, TrialState
from services.api.farm import TheFarm
from services.api.overview import load_of
from services.jobs.totals import attempts_ended, robots_wished
from trial_logs.disk import room

router = APIRouter(tags=["farm"])


@dataclass(frozen=True, eq=False)  # a registry asks which one it is
class Attempts:
    """How many attempts of this farm have ended, and by whose fault. Truth is the rows of jobs."""

    ended: Mapping[Fault, int]

    def collect(self) -> Iterable[CounterMetricFamily]:
        """The counter; every services process of a farm says the same, so that one of them is enough."""
        ended = CounterMetricFamily("trifarm_attempts", "Attempts that ended, by whose fault it was", labels=["fault"])
        for fault, count in self.ended.items():
            ended.add_metric([str(fault)], count)
        return (ended,)


@router.get("/metrics", response_class=PlainTextResponse)
async def metrics(farm: TheFarm) -> Response:
    """Counters of this process and gauges of the farm, for Prometheus."""
    load, registry = await load_of(farm), CollectorRegistry()
    _gauge(registry, "trifarm_robots", "Robots by state", load.robots, "state")
    _gauge(registry, "trifarm_jobs", "Jobs by state", load.work.jobs, "state")
    trials = {TrialState.QUEUED: load.work.trials_queued, TrialState.RUNNING: load.work.trials_running}
    _gauge(registry, "trifarm_trials", "Trials of unended jobs by state", {str(k): v for k, v in trials.items()}, "state")
    Gauge("trifarm_oldest_queued_seconds", "Age of the oldest queued job", registry=registry).set(load.work.oldest_queued_s or 0)
    found = room(farm.settings.data)
    Gauge("trifarm_disk_free_bytes", "Free on the disk of the data folder", registry=registry).set(found.free_bytes)
    reserve = Gauge("trifarm_disk_reserve_bytes", "With less free, nothing new is accepted", registry=registry)
    reserve.set(farm.settings.disk_reserve_bytes)
    async with farm.database.read() as connection:
        could_run = Gauge("trifarm_robots_wished", "Trials that could run at once, with a robot for each", registry=registry)
        could_run.set(await robots_wished(connection, farm.settings.user_trials_at_once))
        registry.register(Attempts(await attempts_ended(connection)))
    return Response(generate_latest(farm.registry) + generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


def _gauge(registry: CollectorRegistry, name: str, words: str, values: dict[str, int], label: str) -> None:
    gauge = Gauge(name, words, [label], registry=registry)
    for value, count in values.items():
        gauge.labels(value).set(count)
