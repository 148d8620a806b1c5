"""One simulation, stepped by a compiled loop: each of the farm's robots has its physics to itself.

``mujoco.batch`` looks after many simulations, and a call of its rollout asks for more than a control period of one can bear. Here
a period is one call that records each step and lets MuJoCo's ``mj_step`` do it, so that the same bits come out. An error within
MuJoCo (not a warning, of which there are counters) ends the process with a line that says so.
"""

import copy
import ctypes
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from sim_backend.driver.compilation import compiled_once
from sim_backend.driver.native_control import field_offset
from sim_backend.driver.physics_batch import Rows

_SIZES = (
    "nq",
    "nv",
    "na",
    "nu",
    "nbody",
    "njnt",
    "ngeom",
    "nsite",
    "ntendon",
    "neq",
    "nM",
    "nuserdata",
    "nsensordata",
    "nhistory",
)
"""What the layout of the data follows from, as far as robots' models could differ in it."""


class LoneSimulation:
    """One simulation, as a batch of one.

    Args:
        model: its model until :meth:`set_models`.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._nominal = self._model = model
        self._data = mujoco.MjData(model)
        self.models: list[mujoco.MjModel] | None = None
        self.warning = self._data.warning.number[None]
        self._fields = (self._data.qpos, self._data.qvel, self._data.ctrl, self._data.sensordata, self._data.warning.number)

    def bind(self, name: str) -> np.ndarray:
        """A field of the simulation, shape (1, size), to be read and written in place."""
        if name == "time":
            return np.ctypeslib.as_array((ctypes.c_double * 1).from_address(_address(self._data) + field_offset("mjData", name)))
        values: np.ndarray = getattr(self._data, name)
        return values[None]

    def set_models(self, models: Sequence[mujoco.MjModel] | None) -> None:
        """Another model for the simulation, in a list; that which it was made with if None.

        Raises:
            ValueError: its sizes are others.
        """
        wanted = self._nominal if models is None else models[0]
        if differs := [name for name in _SIZES if getattr(wanted, name) != getattr(self._nominal, name)]:
            raise ValueError(f"the model has another {', '.join(differs)} than the one that the simulation was made with")
        self._model, self.models = wanted, None if models is None else list(models)

    def reset(self, *, ids: np.ndarray, stage: Any) -> None:
        """Put it into its initial state if it is in ``ids``; nothing is computed from it (``stage`` is ``mjSTAGE_NONE``)."""
        if stage != mujoco.mjtStage.mjSTAGE_NONE:
            raise NotImplementedError("a reset that computes a stage")
        if len(ids):
            mujoco.mj_resetData(self._model, self._data)

    def forward(self, *, ids: np.ndarray) -> None:
        """Compute what follows from its state if it is in ``ids``."""
        if len(ids):
            mujoco.mj_forward(self._model, self._data)

    def get_data(self, _robot: int) -> mujoco.MjData:
        """A copy of the whole simulation."""
        return copy.copy(self._data)

    def advance(self, torque_nm: np.ndarray, *, report: bool) -> Rows:
        """Advance by some steps with a torque of its own in each; as :class:`~sim_backend.driver.physics_batch.PhysicsBatch`."""
        steps, model = torque_nm.shape[1], self._model
        qpos, qvel, ctrl = (np.empty((1, steps, size)) for size in (model.nq, model.nv, model.nu))
        reports = np.empty((1, steps, model.nsensordata) if report else (1, 0, 0))
        torques = np.ascontiguousarray(torque_nm, dtype=np.float64)
        _advancer()(_step_address(), _address(model), _address(self._data), *self._fields, torques, qpos, qvel, ctrl, reports)
        return Rows(qpos, qvel, ctrl, reports if report else None)


def _address(struct: mujoco.MjModel | mujoco.MjData) -> int:
    """Where it is in memory."""
    return struct._address  # pyrefly: ignore[missing-attribute] - the stubs leave out what has an underscore


@functools.cache
def _step_address() -> int:
    """Where MuJoCo's ``mj_step`` is in this process.

    Raises:
        RuntimeError: MuJoCo's library is not where its package has it.
    """
    found = [path for path in Path(mujoco.__file__).parent.iterdir() if path.name.startswith(("libmujoco.", "mujoco.dll"))]
    if len(found) != 1:
        raise RuntimeError(f"the mujoco package has {len(found)} libraries of MuJoCo instead of one; install it again")
    address = ctypes.cast(ctypes.CDLL(str(found[0])).mj_step, ctypes.c_void_p).value
    assert address is not None, "a function that was found has an address"
    return address


@intrinsic
def _step(_context: object, _address: types.Type, _model: types.Type, _data: types.Type) -> tuple[Any, Callable[..., Any]]:
    """Call ``mj_step``; all three are addresses."""

    def generate(context: Any, builder: Any, _signature: object, arguments: Sequence[Any]) -> Any:
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        address, model, data = arguments
        called = builder.inttoptr(address, kind.as_pointer())
        builder.call(called, [builder.inttoptr(model, pointer), builder.inttoptr(data, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


def advance(
    address: int,
    model: int,
    data: int,
    qpos: np.ndarray,
    qvel: np.ndarray,
    ctrl: np.ndarray,
    sensordata: np.ndarray,
    warnings: np.ndarray,
    torque: np.ndarray,
    qpos_rows: np.ndarray,
    qvel_rows: np.ndarray,
    ctrl_rows: np.ndarray,
    report_rows: np.ndarray,
) -> None:
    """Do some steps and record each: the state before it, the torque that acted and what was reported.

    A simulation of which MuJoCo warns stops; what is left of its records repeats the last.

    Args:
        address: of ``mj_step``.
        model: address of the model.
        data: address of the data.
        qpos: the data's positions, shape (nq,); the next four are the data's, too.
        qvel: shape (nv,).
        ctrl: shape (nu,).
        sensordata: shape (nsensordata,).
        warnings: counters of warnings.
        torque: desired, shape (1, steps, nu), N m.
        qpos_rows: filled, shape (1, steps, nq).
        qvel_rows: filled, shape (1, steps, nv).
        ctrl_rows: filled, shape (1, steps, nu).
        report_rows: filled, shape (1, steps, nsensordata), or (1, 0, 0) if nobody wants them.
    """
    steps, reported = torque.shape[1], report_rows.shape[1] > 0
    for step in range(steps):
        _copy(qpos, qpos_rows[0, step])
        _copy(qvel, qvel_rows[0, step])
        _copy(torque[0, step], ctrl)
        _step(address, model, data)  # pyrefly: ignore[missing-argument, bad-argument-type]
        _copy(ctrl, ctrl_rows[0, step])
        if reported:
            _copy(sensordata, report_rows[0, step])
        if _warned(warnings):
            for rows in (qpos_rows, qvel_rows, ctrl_rows, report_rows):
                rows[:, step + 1 :] = rows[:, step : step + 1]
            return


@numba.njit
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    """An assignment, without looking whether they overlap."""
    for index in range(len(source)):
        target[index] = source[index]


@numba.njit
def _warned(warnings: np.ndarray) -> bool:
    """Whether there was a warning since the reset."""
    return warnings.max() > 0


@functools.cache
def _advancer() -> Callable[..., None]:
    """:func:`advance`, compiled once a machine; other threads go on meanwhile."""
    field, counters, rows = types.float64[::1], types.int32[:], types.float64[:, :, ::1]
    torques = types.Array(types.float64, 3, "C", readonly=True)
    signature = types.void(*(types.int64,) * 3, *(field,) * 4, counters, torques, *(rows,) * 4)
    return compiled_once(lambda cache: numba.njit([signature], cache=cache, nogil=True)(advance))
