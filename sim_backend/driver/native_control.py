"""The safety pipeline as a compiled MuJoCo control callback, so that it acts every millisecond without Python.

MuJoCo calls it once a step with pointers to the model and the data. It reads the desired torque from ``ctrl``, its settings
from the simulation's ``userdata`` and writes the applied torque back to ``ctrl``, which is therefore what a rollout records.
Models without ``userdata`` are left alone, so that a replay can drive the same joints by the recorded torques.

The addresses of the fields come from MuJoCo's own description of its structs (``mujoco.introspect``).
"""

# mujoco fills its namespace when it is imported, which the type checker cannot see
# pyright: reportAttributeAccessIssue=false
import ctypes
import functools

import mujoco
import numba
from mujoco.introspect.ast_nodes import ArrayType, PointerType
from mujoco.introspect.structs import STRUCTS
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage]

from sim_backend.driver.safety import joint_applied_torque_nm
from sim_backend.trifinger import constants as c

SLOT_SAFETY_ON = 0
"""1.0 where the safety pipeline acts, 0.0 where ``ctrl`` passes unchanged."""
SLOT_POSITION_TARGET = 1
"""First of nine position targets, rad, NaN for none."""
CONTROL_SLOTS = SLOT_POSITION_TARGET + 9

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


def _ctype(described):
    """The ctypes equivalent of a C type as MuJoCo describes it; what is neither scalar nor struct is an enum."""
    if isinstance(described, ArrayType):
        inner = _ctype(described.inner_type)
        for extent in reversed(described.extents):
            inner = inner * extent
        return inner
    if isinstance(described, PointerType):
        return ctypes.c_void_p
    name = described.name.rstrip("_")
    if name in _SCALARS:
        return _SCALARS[name]
    return _struct(name) if name in STRUCTS else ctypes.c_int


def _struct(name: str, last_field: str | None = None) -> type[ctypes.Structure]:
    """A struct of MuJoCo, up to and including ``last_field`` if given (what follows does not move it)."""
    described = STRUCTS[name].fields
    if last_field is not None:
        described = described[: [field.name for field in described].index(last_field) + 1]
    return type(name, (ctypes.Structure,), {"_fields_": [(field.name, _ctype(field.type)) for field in described]})


def field_word(struct: str, field: str) -> int:
    """Position of a field in ``mjData`` or ``mjModel``, in words of 8 bytes from the struct's start."""
    offset: int = getattr(_struct(struct, field), field).offset
    assert offset % 8 == 0, f"{struct}.{field} is not aligned"
    return offset // 8


@functools.cache
def _compiled():
    """The callback, compiled once a process (0.2 s)."""
    nuserdata, qpos, qvel, ctrl, userdata = (
        field_word("mjModel", "nuserdata"),
        *(field_word("mjData", name) for name in ("qpos", "qvel", "ctrl", "userdata")),
    )
    lower, upper = tuple(c.SOFT_LIMIT_LOWER_RAD), tuple(c.SOFT_LIMIT_UPPER_RAD)
    kp, kd = tuple(c.POSITION_GAIN_NM_RAD), tuple(c.VELOCITY_GAIN_NM_S_RAD)
    damping, limit = tuple(c.SAFETY_DAMPING_NM_S_RAD), c.MAX_TORQUE_NM
    signature = types.void(types.CPointer(types.int64), types.CPointer(types.CPointer(types.float64)))

    @numba.cfunc(signature)
    def control(model, data):
        if model[nuserdata] < CONTROL_SLOTS:
            return
        slots = carray(data[userdata], (CONTROL_SLOTS,))
        if slots[SLOT_SAFETY_ON] == 0.0:
            return
        position, velocity, torque = carray(data[qpos], (9,)), carray(data[qvel], (9,)), carray(data[ctrl], (9,))
        for j in range(9):
            torque[j] = joint_applied_torque_nm(
                torque[j],
                slots[SLOT_POSITION_TARGET + j],
                position[j],
                velocity[j],
                lower[j],
                upper[j],
                kp[j],
                kd[j],
                damping[j],
                limit,
            )

    return control


@functools.cache
def _silence():
    """A warning handler that says nothing; MuJoCo's own writes a file into the user's folder. Counters still count."""

    @numba.cfunc(types.void(types.voidptr))
    def ignore(_text):
        pass

    return ignore


def install() -> None:
    """Make MuJoCo call the compiled safety pipeline in this process (it acts only on models that reserve its slots)."""
    mujoco.set_mjcb_control(_compiled().ctypes)
    mujoco.set_mju_user_warning(_silence().ctypes)
