"""Safety pipeline and effects as a compiled MuJoCo control callback, so that they act every millisecond without Python.

MuJoCo calls it once a step with pointers to the model and the data. It reads the desired torque from ``ctrl``, settings and
states from the simulation's ``userdata`` (``effects/record.py``) and writes the applied torque back to ``ctrl``, which is
therefore what a rollout records. What effects add goes to ``qfrc_applied`` and to the bounds of the friction constraints, what
the encoders report goes to ``sensordata``. Models without ``userdata`` are left alone, so that a replay can drive the same
joints by the recorded torques.

The addresses of the fields come from MuJoCo's own description of its structs (``mujoco.introspect``).
"""

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any, cast

import mujoco
import numba
import numpy as np
from mujoco.introspect.ast_nodes import AnonymousStructDecl, ArrayType, PointerType, StructFieldDecl, ValueType
from mujoco.introspect.structs import STRUCTS
from numba import carray, types
from numba.extending import intrinsic

from sim_backend.driver import wall_watch
from sim_backend.driver.compilation import compiled_once
from sim_backend.driver.control_step import protect_nominal, set_bounds, step_with_effects
from sim_backend.driver.joint_reports import measure_joints
from sim_backend.effects import record as r
from sim_backend.trifinger.scene import ARENA_BITS, WALL_PARTS

_SCALARS = {
    "int": ctypes.c_int,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtByte": ctypes.c_uint8,
    "mjtBool": ctypes.c_bool,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
}


def _ctype(described: object) -> Any:
    """The ctypes equivalent of a C type as MuJoCo describes it; what is neither scalar nor struct is an enum."""
    if isinstance(described, ArrayType):
        inner = _ctype(described.inner_type)
        for extent in reversed(described.extents):
            inner = inner * extent
        return inner
    if isinstance(described, PointerType):
        return ctypes.c_void_p
    if isinstance(described, AnonymousStructDecl):
        return _of_fields("unnamed", cast(Sequence[StructFieldDecl], described.fields))
    name = cast(ValueType, described).name.rstrip("_")
    if name in _SCALARS:
        return _SCALARS[name]
    return _struct(name) if name in STRUCTS else ctypes.c_int


def _struct(name: str, last_field: str | None = None) -> type[ctypes.Structure]:
    """A struct of MuJoCo, up to and including ``last_field`` if given (what follows does not move it)."""
    described = cast(Sequence[StructFieldDecl], STRUCTS[name].fields)  # those that are followed here have no unions
    if last_field is not None:
        described = described[: [field.name for field in described].index(last_field) + 1]
    return _of_fields(name, described)


def _of_fields(name: str, described: Sequence[StructFieldDecl]) -> type[ctypes.Structure]:
    return type(name, (ctypes.Structure,), {"_fields_": [(field.name, _ctype(field.type)) for field in described]})


def field_offset(struct: str, field: str) -> int:
    """Position of a field in ``mjData`` or ``mjModel``, in bytes from the struct's start."""
    offset: int = getattr(_struct(struct, field), field).offset
    return offset


def field_word(struct: str, field: str) -> int:
    """Position of a field in words of 8 bytes."""
    offset = field_offset(struct, field)
    assert offset % 8 == 0, f"{struct}.{field} is not aligned"
    return offset // 8


@intrinsic
def _untyped(_context: object, pointer: types.Type) -> tuple[Any, Callable[..., Any]]:
    """A pointer to anything as a pointer to nothing, so that a struct can be looked at as an array of integers."""

    def generate(context: Any, builder: Any, _signature: object, arguments: Sequence[Any]) -> Any:
        return builder.bitcast(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(pointer), generate


@intrinsic
def _pointers(_context: object, pointer: types.Type) -> tuple[Any, Callable[..., Any]]:
    """A pointer to anything as a pointer to pointers, so that a struct can be looked at as an array of these."""

    def generate(context: Any, builder: Any, _signature: object, arguments: Sequence[Any]) -> Any:
        return builder.bitcast(arguments[0], context.get_value_type(types.CPointer(types.voidptr)))

    return types.CPointer(types.voidptr)(pointer), generate


@numba.njit
def _watch(model: np.ndarray, data: np.ndarray, first: int, words: tuple[int, ...]) -> None:
    """Switch parts of the wall in a model off and on, for what is where in its data; words of :func:`_wall_words`."""
    ngeom, step_word, body_contype, body_conaffinity, geom_contype, kinds, sizes, radii, xpos, xmat, qvel = words
    count, of_model = model[ngeom], _pointers(model)  # pyrefly: ignore[missing-argument]
    step_s = carray(_untyped(model), (step_word + 1,), np.float64)[step_word]  # pyrefly: ignore[missing-argument]
    bits = np.empty(WALL_PARTS, np.int32)
    wall_watch.look(
        first,
        carray(of_model[kinds], (count,), np.int32),
        carray(of_model[geom_contype], (count,), np.int32),
        carray(of_model[sizes], (count, 3), np.float64),
        carray(of_model[radii], (count,), np.float64),
        carray(data[xpos], (count, 3), np.float64),
        carray(data[xmat], (count, 9), np.float64),
        wall_watch.reach_m(carray(data[qvel], (15,), np.float64), step_s),
        bits,
    )
    wall_contype = carray(of_model[body_contype], (WALL_PARTS + 1,), np.int32)
    wall_conaffinity = carray(of_model[body_conaffinity], (WALL_PARTS + 1,), np.int32)
    for part in range(WALL_PARTS):
        wall_contype[1 + part] = ARENA_BITS * bits[part]
        wall_conaffinity[1 + part] = wall_watch.TOUCHING_BITS * bits[part]


def _wall_words() -> tuple[int, ...]:
    """Where :func:`_watch` finds arrays: integers, since numba finds no function again that another holds."""
    assert field_offset("mjOption", "timestep") == 0
    of_model = ("ngeom", "opt", "body_contype", "body_conaffinity", "geom_contype", "geom_type", "geom_size", "geom_rbound")
    of_data = ("geom_xpos", "geom_xmat", "qvel")
    return (*(field_word("mjModel", name) for name in of_model), *(field_word("mjData", name) for name in of_data))


@functools.cache
def _compiled() -> Any:
    """The callback, compiled once a process."""
    words = _wall_words()
    nuserdata, nsensordata = (field_word("mjModel", name) for name in ("nuserdata", "nsensordata"))
    qpos, qvel, ctrl, userdata, sensordata, qfrc_applied, qfrc_bias = (
        field_word("mjData", name) for name in ("qpos", "qvel", "ctrl", "userdata", "sensordata", "qfrc_applied", "qfrc_bias")
    )
    kinds, bounds, island_bounds, island_rows = (
        field_word("mjData", name) for name in ("efc_type", "efc_frictionloss", "iefc_frictionloss", "map_efc2iefc")
    )
    nefc, nisland = (field_offset("mjData", name) // 4 for name in ("nefc", "nisland"))
    integers, friction = max(nefc, nisland) + 1, int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    signature = types.void(types.CPointer(types.int64), types.CPointer(types.voidptr))

    def control(model: np.ndarray, data: np.ndarray) -> None:
        size = model[nuserdata]
        if size < r.CONTROL_SLOTS:
            return
        slots = carray(data[userdata], (size,), np.float64)
        if slots[r.AFTER_WALL] > 0.0:
            _watch(model, data, int(slots[r.AFTER_WALL]), words)
        position, velocity = carray(data[qpos], (9,), np.float64), carray(data[qvel], (9,), np.float64)
        torque = carray(data[ctrl], (9,), np.float64)
        if slots[r.EFFECTS_ON] == 0.0 or size < r.SMALLEST or model[nsensordata] < r.REPORT_SIZE:
            if slots[r.SAFETY_ON] == 1.0:
                protect_nominal(slots, torque, position, velocity)
            return
        report = carray(data[sensordata], (r.REPORT_SIZE,), np.float64)
        force = carray(data[qfrc_applied], (12,), np.float64)
        step_with_effects(slots, torque, position, velocity, report, force)
        counts = carray(_untyped(data), (integers,), np.int32)  # pyrefly: ignore[missing-argument]
        if slots[r.BOUNDS_ON] == 0.0 or counts[nefc] < 9:
            return
        kind = carray(data[kinds], (9,), np.int32)
        if kind[0] != friction or kind[8] != friction:  # rows come joint by joint, before those of limits and contacts
            return
        in_order, bias = carray(data[bounds], (9,), np.float64), carray(data[qfrc_bias], (9,), np.float64)
        set_bounds(slots, velocity, bias, report, in_order)
        if counts[nisland] > 0:  # then the solver works on a copy that is sorted by islands
            rows, by_island = carray(data[island_rows], (9,), np.int32), carray(data[island_bounds], (counts[nefc],), np.float64)
            for j in range(9):
                by_island[rows[j]] = in_order[j]

    return compiled_once(lambda cache: numba.cfunc(signature, cache=cache)(control))


@functools.cache
def measurer() -> Callable[..., None]:
    """``joint_reports.measure_joints``, compiled once a process."""
    rows = types.float64[:, :]
    return compiled_once(lambda cache: numba.njit([(rows,) * 5], cache=cache)(measure_joints.py_func))


@functools.cache
def _silence() -> Any:
    """A warning handler that says nothing; MuJoCo's own writes a file into the user's folder. Counters still count."""

    @numba.cfunc(types.void(types.voidptr))
    def ignore(_text: object) -> None:
        pass

    return ignore


@functools.cache
def _no_clock() -> Any:
    """A clock that stands still: MuJoCo reads its own some twenty times a step for timers that nobody looks at here."""

    @numba.cfunc(types.double())
    def stand_still() -> float:
        return 0.0

    return stand_still


def silence_warnings() -> None:
    """Keep MuJoCo from writing its warnings into the user's folder: who simulates looks at its counters or at what came out."""
    mujoco.set_mju_user_warning(_silence().ctypes)


def install() -> None:
    """Make MuJoCo call the compiled safety pipeline in this process (it acts only on models that reserve its slots)."""
    mujoco.set_mjcb_control(_compiled().ctypes)
    silence_warnings()
    mujoco.set_mjcb_time(_no_clock().ctypes)
