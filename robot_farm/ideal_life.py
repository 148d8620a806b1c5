"""The life of an ideal robot: one without effects, in which nothing warms, wears, breaks or has to be tested."""

from contextlib import AbstractContextManager

from api_schemas.robot import Lease
from robot_farm import trial
from robot_farm.life import StopReason
from robot_farm.prepared import Prepared, prepare_plainly, shape_of_lease
from robot_farm.sight import Sight
from robot_farm.truth import TruthFile
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.tasks import TASKS
from trial_logs.trial_log import LogChannels


class IdealLife:
    """A life (``robot_farm/life.py``) of a robot that is like all others. Owner of its driver.

    It hides nothing, so that its logs hold the truth; it is never unfit, and takes no turn on its core to find out.

    Args:
        sight: what finds the object for it; the formula if None.
    """

    physics_digest = ""
    wrong: str | None = None
    tests_ended = 0
    temperature_rise_k: float | None = None

    def __init__(self, sight: Sight | None = None) -> None:
        self._sight = Sight() if sight is None else sight
        self._driver: SimulatedDriver | None = None

    def log_channels(self) -> LogChannels:
        """The channels of its logs: what a real robot could give and the truth."""
        return trial.log_channels()

    @property
    def driver(self) -> SimulatedDriver:
        """The robot's driver; another one when there is another object in the arena."""
        assert self._driver is not None, "prepare the robot first"
        return self._driver

    def prepare(self, lease: Lease, truth: TruthFile, stop_reason: StopReason) -> Prepared:  # noqa: ARG002 - as every life
        """Everything from the lease alone: the object is placed where the seed says."""
        shape = shape_of_lease(lease)
        if self._driver is None or self._driver.shape != shape:
            self._driver = SimulatedDriver(shape=shape)
        return prepare_plainly(lease, TASKS, self._sight)

    def test_in_turn(self, turn: AbstractContextManager[None], stop_reason: StopReason) -> str | None:  # noqa: ARG002 - as every life
        """There is nothing to test, and nothing to say of it."""
        return None

    def forget(self) -> None:
        """Nothing of the last trial is trusted any more."""
        self._driver = None
