"""A trial's log as named NumPy arrays, and as tables of pandas and Arrow."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sim_backend.trifinger import constants as c
from trial_logs import reader

if TYPE_CHECKING:
    import pandas
    import pyarrow

TableName = Literal["joints", "cube", "tracker", "policy"]
AXES = ("x", "y", "z")
QUATERNION = ("w", "x", "y", "z")
STEP_S = c.PHYSICS_STEP_S


@dataclass(frozen=True)
class Log(reader.TrialLog):
    """A trial's log: arrays whose names say their unit and frame, with one row for each time.

    | attributes | shape | times |
    |---|---|---|
    | ``joint_position_rad``, ``joint_velocity_rad_s``, ``measured_torque_nm``, ``desired_torque_nm``, ``applied_torque_nm`` | (n, 9) | ``joint_time_s``, every millisecond |
    | ``tracked_position_world_m``, ``tracked_quat_wxyz``, ``confidence`` | (k, 3), (k, 4), (k,) | ``capture_s`` seen, ``delivery_s`` told |
    | ``observation``, ``action`` | (p, size), (p, 9) | ``policy_time_s`` |
    | ``cube_position_world_m``, ``cube_quat_wxyz`` | (m, 3), (m, 4) | ``cube_time_s``; empty unless the robot is nominal |

    ``goal`` is the wanted pose (position in m, quaternion wxyz) or None; ``metadata`` and ``outcome`` are texts by name.

    Example:
        >>> import trifarm
        >>> log = trifarm.read_log("trial-000.mcap")
        >>> isinstance(log, trifarm.Log)
        True
        >>> log.joint_position_rad.shape[1]
        9
    """  # noqa: E501 - a row of a table is a line

    @property
    def joint_time_s(self) -> np.ndarray:
        """Time of each row of joints since the start of the trial, s, shape (n,)."""
        return self.joint_steps * STEP_S

    @property
    def cube_time_s(self) -> np.ndarray:
        """Time of each true pose of the cube since the start of the trial, s, shape (m,)."""
        return self.cube_steps * STEP_S

    @property
    def policy_time_s(self) -> np.ndarray:
        """Time of each observation of the policy since the start of the trial, s, shape (p,)."""
        return self.policy_steps * STEP_S

    def columns(self, table: TableName = "joints") -> dict[str, np.ndarray]:
        """One of the log's tables as columns of the same length.

        Args:
            table: ``joints``, ``cube``, ``tracker`` or ``policy``; each has times of its own.

        Returns:
            Arrays of shape (rows,) by name; the first is ``time_s`` (of the exposure where the tracker reports).

        Raises:
            ValueError: there is no such table.
        """
        columns: dict[str, np.ndarray] = {}
        for name, values, parts in self._parts(table):
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}.{part}": values[:, index] for index, part in enumerate(parts)}
        return columns

    def to_arrow(self, table: TableName = "joints") -> "pyarrow.Table":
        """One of the log's tables for Arrow; see :meth:`columns`.

        Raises:
            ImportError: pyarrow is not installed.

        Example:
            >>> import trifarm
            >>> trifarm.read_log("trial-000.mcap").to_arrow("tracker").column_names[:2]
            ['time_s', 'delivery_s']
        """
        import pyarrow

        return pyarrow.table(self.columns(table))

    def to_pandas(self, table: TableName = "joints") -> "pandas.DataFrame":
        """One of the log's tables for pandas; see :meth:`columns`.

        Raises:
            ImportError: pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise ImportError("Log.to_pandas needs pandas: pip install pandas; to_arrow works without it") from error
        return pandas.DataFrame(self.columns(table))

    def _parts(self, table: TableName) -> tuple[tuple[str, np.ndarray, tuple[str, ...]], ...]:
        joints = tuple(c.JOINT_NAMES)
        match table:
            case "joints":
                names = (
                    "joint_position_rad",
                    "joint_velocity_rad_s",
                    "measured_torque_nm",
                    "desired_torque_nm",
                    "applied_torque_nm",
                )
                return (("time_s", self.joint_time_s, ()), *((name, getattr(self, name), joints) for name in names))
            case "cube":
                return (
                    ("time_s", self.cube_time_s, ()),
                    ("cube_position_world_m", self.cube_position_world_m, AXES),
                    ("cube_quat", self.cube_quat_wxyz, QUATERNION),
                )
            case "tracker":
                return (
                    ("time_s", self.capture_s, ()),
                    ("delivery_s", self.delivery_s, ()),
                    ("confidence", self.confidence, ()),
                    ("tracked_position_world_m", self.tracked_position_world_m, AXES),
                    ("tracked_quat", self.tracked_quat_wxyz, QUATERNION),
                )
            case "policy":
                seen = tuple(str(index) for index in range(self.observation.shape[1] if self.observation.ndim > 1 else 0))
                return (
                    ("time_s", self.policy_time_s, ()),
                    ("observation", self.observation, seen),
                    ("action", self.action, joints),
                )
        raise ValueError(f"there is no table {table!r} in a log; choose from joints, cube, tracker, policy")


def read_log(path: Path | str) -> Log:
    """Reads a trial's log.

    Args:
        path: the .mcap file, as ``trifarm fetch`` brings it.

    Raises:
        LogUnreadableError: the file is missing, truncated, damaged or no trial's log; the message says which.

    Example:
        >>> import trifarm
        >>> log = trifarm.read_log("trial-000.mcap")
        >>> log.metadata["task"], log.applied_torque_nm.dtype.name
        ('push', 'float64')
    """
    return as_log(reader.read_log(path))


def as_log(found: reader.TrialLog) -> Log:
    """The same arrays with what :class:`Log` adds."""
    values: Mapping[str, object] = {field.name: getattr(found, field.name) for field in fields(found)}
    return Log(**values)  # pyrefly: ignore[bad-argument-type] - the fields are those of the class that it extends
