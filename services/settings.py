"""Settings of the services process: every flag of ``serve`` is also a ``TRIFARM_*`` environment variable."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, Field, SecretStr, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from api_schemas.job import MAX_TRIALS
from api_schemas.physics import physics_name
from api_schemas.policy import MAX_WEIGHTS_BYTES
from api_schemas.robot import LEASE_S, RENEW_EVERY_S
from jail.level import JailLevel

TRIALS_PAGE = 500
AUDIT = "audit"
"""Name of the logger whose lines go into ``audit_file``."""


class Settings(BaseSettings):
    """What one services process was told; read once at the start and passed on.

    A variable that is none of these is warned of at the start and not refused; ``api_schemas/environment.py`` says why.
    """

    model_config = SettingsConfigDict(env_prefix="TRIFARM_", frozen=True, extra="ignore")

    data: Path = Field(default=Path("farm-data"), description="folder of database, files and tokens")
    host: str = Field(default="127.0.0.1", description="address on which the API listens")
    port: int = Field(default=8787, ge=0, le=65535, description="port on which it listens")
    bus: str = Field(default="tcp/127.0.0.1:7447", description="where the bus listens, guarded where it begins with tls/")
    bus_connect: str | None = Field(
        default=None, description="a router elsewhere, or several by commas; without it one listens on ``bus`` here"
    )
    bus_routers: str | None = Field(
        default=None,
        description="for a router: all of the same bus, by commas; it keeps links to those that are not in ``bus_addresses``",
    )
    bus_addresses: str | None = Field(
        default=None, description="what robots are told of the bus, by commas, as tls/farm.example.org:7447; usual: where it is"
    )
    bus_robots: int = Field(default=100, ge=1, description="on a guarded bus robot-0 and so on, so many, may join")
    bus_certificate_s: float = Field(
        default=6 * 3600.0,
        gt=0,
        description="how long a robot's certificate lasts; a revoked one leaves the bus with it",
    )
    farm: str = Field(default="farm", pattern=r"^[a-z0-9-]{1,40}$", description="the farm's name on the bus")
    physics: Annotated[str, AfterValidator(physics_name)] = Field(
        default="real", description="what the robots were told; only the name is kept"
    )
    tls_certificate: Path | None = Field(default=None, description="PEM file with the certificate and its chain: for https")
    tls_key: Path | None = Field(default=None, description="PEM file with the certificate's private key")
    admin_token: SecretStr | None = Field(default=None, description="made valid with all scopes at the start")
    robot_token: SecretStr | None = Field(default=None, description="made valid at the start, for robots to join with")
    farm_key: SecretStr | None = Field(
        default=None, description="32 bytes as hexadecimal digits; without it, one in the data folder"
    )
    bus_key: SecretStr | None = Field(
        default=None, description="for a guarded router: what bus-key prints; with it, it needs nothing else of the farm's key"
    )
    max_attempts: int = Field(default=5, ge=1, description="platform faults of one trial before its job fails")
    pass_over_s: float = Field(default=30.0, ge=0, description="how long a trial waits for its busy first choice")
    pinned_robot_gone_s: float = Field(
        default=600.0, gt=0, description="a job whose one robot is out of service or lost for so long fails"
    )
    offer_timeout_s: float = Field(default=2.0, gt=0, description="how long a robot has to answer an offer")
    refused_pause_s: float = Field(default=1.0, ge=0, description="a robot that refused is not offered again for so long")
    lease_s: float = Field(default=LEASE_S, gt=0, description="how long a lease lives without renewal")
    renew_every_s: float = Field(
        default=RENEW_EVERY_S, gt=0, description="how often robots renew; one that was lost has so long and 1 s to come back"
    )
    sweep_every_s: float = Field(default=0.5, gt=0, description="the safety net under the events that wake the dispatcher")
    max_weights_bytes: int = Field(default=MAX_WEIGHTS_BYTES, gt=0, description="of one policy's weights")
    max_queued_jobs_per_user: int = Field(default=200, ge=1, description="jobs of one user that have not ended")
    max_trials_per_job: int = Field(
        default=10_000, ge=1, le=MAX_TRIALS, description=f"of a job that a user asks for; operators may ask for {MAX_TRIALS}"
    )
    max_queued_trials_per_user: int = Field(
        default=200_000, ge=1, description="trials that are not done of the jobs of one user that have not ended"
    )
    trials_page: int = Field(
        default=TRIALS_PAGE,
        ge=1,
        le=TRIALS_PAGE,
        description="of a job, made in one transaction; those of a larger job follow",
    )
    max_policy_bytes_per_user: int = Field(
        default=10 * 1024**3, gt=0, description="one user's policies together, weights and graphs"
    )
    requests_per_s: float = Field(default=100.0, ge=0, description="of one token, ten seconds' worth at once; 0: no limit")
    robot_requests_per_s: float = Field(default=1000.0, ge=0, description="the same for the token of a robot")
    anonymous_requests_per_s: float = Field(default=10.0, ge=0, description="of one address without a token that is known good")
    head_within_s: float = Field(default=10.0, gt=0, description="a connection on which no head of a request comes is closed")
    body_stall_s: float = Field(default=30.0, gt=0, description="a request of whose body nothing comes for so long is refused")
    hosts: str | None = Field(
        default=None, description="names under which the services may be asked, by commas; usual: on loopback its names, else any"
    )
    trusted_proxies: str | None = Field(default=None, description="addresses whose X-Forwarded-For is believed, by commas")
    max_log_bytes: int = Field(default=1024**3, gt=0, description="of one trial's log")
    audit_file: Path | None = Field(default=None, description="where audit lines go; without it, to standard error")
    disk_reserve_bytes: int = Field(
        default=8 * 1024**2, ge=0, description="with less free in the data folder nothing new is accepted, what runs is finished"
    )
    conversion_deadline_s: float = Field(default=60.0, gt=0, description="for making a graph of uploaded weights")
    verification_deadline_s: float = Field(default=120.0, gt=0, description="for simulating a log again")
    verification_upload_s: float = Field(default=120.0, gt=0, description="how long a log to be verified may take to arrive")
    verification_at_once: int = Field(default=1, ge=1, description="logs that may be simulated again at the same time")
    whys_per_robot: int = Field(
        default=20, ge=0, description="questions why a trial failed that a user may ask of one robot; 0: none"
    )
    why_deadline_s: float = Field(default=900.0, gt=0, description="for the replays that answer one such question")
    conversion_at_once: int = Field(default=1, ge=1, description="conversions that may run at the same time")
    jail_level: JailLevel = Field(
        default=JailLevel.LIMITS, description="no policy and no log is taken where the jail of children does not reach this level"
    )

    # Where "open in" of a trial leads; the address of a signed link to its log is put behind, so that the viewer's site comes
    # to know it. None: not offered.
    foxglove_url: str | None = Field(
        default=None, description="'open in' of a trial leads there, as https://app.foxglove.dev/~/view?ds=remote-file&ds.url="
    )
    lichtblick_url: str | None = Field(default=None, description="likewise, as https://lichtblick.host/?ds=remote-file&ds.url=")
    rerun_url: str | None = Field(default=None, description="likewise, as https://rerun.io/viewer?url=")
    shares: bool = Field(default=False, description="whether users may share a report or a trial by a link that needs no token")
    public_leaderboard: bool = Field(
        default=False, description="whether the page of leaderboards is shown without a token, policies by digest"
    )
    webhooks: bool = Field(default=False, description="whether jobs may name an address that is called at their end")
    studies: Path | None = Field(default=None, description="folder of the reality gap's reports; without it, in the data folder")

    # The two homes: without these, truth and files are in the data folder.
    database_url: str | None = Field(default=None, repr=False, description="postgresql://user:password@host/name")
    files_url: str | None = Field(default=None, description="s3://bucket/prefix")
    s3_endpoint: str | None = Field(default=None, description="of an S3 server that is not Amazon's, as http://host:7070")
    s3_region: str = Field(default="us-east-1", description="of the bucket")
    s3_access_key_id: str | None = Field(default=None, description="without it, what AWS_* variables or the machine give")
    s3_secret_access_key: SecretStr | None = Field(default=None, description="belongs to it")
    dispatches: bool = Field(default=True, description="false: this process answers requests and gives no leases")
    metrics_port: int | None = Field(
        default=None,
        ge=1,
        le=65535,
        description="where a dispatcher alone answers ``/metrics``, on ``host``; without it, nowhere",
    )
    alive_file: Path | None = Field(
        default=None, description="touched while the dispatcher's loop goes round, for the health check of its container"
    )
    user_trials_at_once: int | None = Field(default=None, ge=1, description="how many trials one user may have running")

    keep_logs_days: float | None = Field(
        default=None, gt=0, description="logs that no report refers to are removed after so long"
    )
    keep_logs_bytes: int | None = Field(default=None, ge=0, description="and the oldest of them where they are more than this")

    @model_validator(mode="after")
    def _bus_is_of_one_kind(self) -> Self:
        own = self.elsewhere or (self.bus, *self.other_routers)
        if len({endpoint.startswith("tls/") for endpoint in (*own, *self.bus_endpoints)}) > 1:
            here, told = ", ".join(own), ", ".join(self.bus_endpoints)
            raise ValueError(f"the bus is {here} and robots would be told {told}; either all begin with tls/ or none")
        return self

    @model_validator(mode="after")
    def _tls_is_whole(self) -> Self:
        if (self.tls_certificate is None) != (self.tls_key is None):
            there, missing = ("TRIFARM_TLS_CERTIFICATE", "TRIFARM_TLS_KEY")[:: 1 if self.tls_key is None else -1]
            raise ValueError(f"{there} is given without {missing}; https needs both files, http neither")
        return self

    @property
    def bus_endpoints(self) -> tuple[str, ...]:
        """What robots are told of the bus."""
        return _endpoints(self.bus_addresses) or self.elsewhere or (self.bus,)

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """The routers that this process is a client of: of one at a time, and of the next where that is gone."""
        return _endpoints(self.bus_connect)

    @property
    def other_routers(self) -> tuple[str, ...]:
        """The routers that the one of this process keeps links to: those it is told of, but for itself."""
        itself = {self.bus, *_endpoints(self.bus_addresses)}
        return tuple(each for each in _endpoints(self.bus_routers) if each not in itself)

    @property
    def guarded_robots(self) -> tuple[str, ...]:
        """The robots that may join where the bus is guarded; its rules name each of them."""
        return tuple(f"robot-{number}" for number in range(self.bus_robots))

    @property
    def truth_url(self) -> str:
        """Where truth is kept; without other word SQLite inside the data folder."""
        return self.database_url or f"sqlite:///{(self.data / 'farm.sqlite').absolute()}"


def _endpoints(by_commas: str | None) -> tuple[str, ...]:
    return tuple(each.strip() for each in (by_commas or "").split(",") if each.strip())
