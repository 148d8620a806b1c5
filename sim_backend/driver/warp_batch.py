"""n simulations on a GPU by mujoco_warp, used as ``mujoco.batch.Batch`` is; needs the extra ``gpu``.

Owner of the simulations' states. Between rollouts they lie in arrays of this process, which the driver reads and writes; in a
rollout they lie on the device. The safety pipeline and the effects of ``Acts.CONTROL`` are the compiled functions of
``control_step.py``, run here before each step on that step's state: MuJoCo's control callback sees the same state, so that one
implementation serves both. The price is a copy of positions, velocities and torques to and from the device in every step.

mujoco_warp calculates in single precision: its trajectories are near MuJoCo's, not the same.
"""

import functools
from collections.abc import Callable
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from sim_backend.driver.compilation import compiled_once
from sim_backend.driver.control_step import protect_nominal, set_bounds, step_with_effects
from sim_backend.driver.physics_batch import BackendError, Rows, UnvariedFieldError
from sim_backend.effects import record as r
from sim_backend.extras import how_to_install

CONTACTS, CONSTRAINTS = 48, 192
"""Room for contacts and rows of constraints in each simulation; the cube between three fingers at the wall needs half of it. One
that needs more is marked as unstable, so that its trial ends instead of going on without some of its contacts."""
LARGEST = 1e10
"""A position, velocity or acceleration beyond this is unstable, as in MuJoCo (mjMAXVAL)."""
VARIED = (
    "body_inertia",
    "body_invweight0",
    "body_iquat",
    "body_mass",
    "body_subtreemass",
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "dof_invweight0",
    "dof_solimp",
    "dof_solref",
    "geom_aabb",
    "geom_friction",
    "geom_pos",
    "geom_rbound",
    "geom_size",
    "geom_solref",
    "jnt_range",
    "jnt_stiffness",
    "pair_friction",
    "pair_solref",
    "qpos_spring",
)
"""Fields of the model that each simulation has for itself, beside gravity."""
WITHOUT_MEANING = ("actuator_acc0", "bvh_aabb", "cam_poscom0", "dof_M0", "dof_length", "light_poscom0", "signature")
"""Fields that may differ although all have those of the nominal model: for muscles, rays, tracking cameras, sleep and lights."""
_GRAVITY = "gravity"
_OUTER_LOAD = r.SLOTS["load_friction.external_coefficient"]


def open_device(device: str | None) -> tuple[Any, Any, str]:
    """The modules ``warp`` and ``mujoco_warp``, and the device's name.

    Args:
        device: as Warp names it; the first GPU if None.

    Raises:
        BackendError: they are not installed, or there is no GPU.
    """
    try:
        import warp  # of the extra, which need not be installed

        warp.config.log_level = warp.LOG_WARNING  # what it tells otherwise goes to the standard output
        import mujoco_warp  # as above
    except ImportError as error:
        missing = f"the physics back end 'warp' needs packages that are not installed ({error.name})"
        raise BackendError(f"{missing}: {how_to_install('gpu')}; or leave physics_backend at 'cpu'") from error
    if device is None and not warp.is_cuda_available():
        found = "the physics back end 'warp' needs an NVIDIA GPU with its driver, and CUDA finds none here"
        raise BackendError(f"{found}: leave physics_backend at 'cpu' ('warp-cpu' runs it on the processor, slowly, for tests)")
    return warp, mujoco_warp, device or "cuda:0"


class WarpBatch:
    """n simulations of one model, or of models that differ in ``VARIED`` and gravity.

    Args:
        model: the nominal model.
        robots: n.
        device: as for :func:`open_device`.
        threads: of the safety pipeline and the effects, which run on the processor.
    """

    def __init__(self, model: mujoco.MjModel, robots: int, *, device: str | None = None, threads: int = 1) -> None:
        self._warp, self._library, self._device = open_device(device)
        self._model, self._n, self._threads = model, robots, min(threads, numba.config.NUMBA_NUM_THREADS)  # pyrefly: ignore[missing-attribute]
        self._host = {"qpos": np.tile(model.qpos0, (robots, 1)), "ctrl": np.zeros((robots, model.nu))}
        self._host |= {name: np.zeros((robots, model.nv)) for name in ("qvel", "qfrc_applied", "qfrc_bias")}
        self._host |= {"userdata": np.zeros((robots, model.nuserdata)), "sensordata": np.zeros((robots, r.REPORT_SIZE))}
        self.warning = np.zeros((robots, 1), dtype=np.int64)
        self._fresh = np.ones(robots, dtype=bool)
        self.models: list[mujoco.MjModel] | None = None
        self._fields: dict[str, np.ndarray] = {}
        with self._warp.ScopedDevice(self._device):
            self._on_device = self._library.put_model(model)
            self._on_device.opt.warn_overflow = 0
            self._data = self._library.make_data(model, nworld=robots, nconmax=CONTACTS, njmax=CONSTRAINTS)
        flags = self._library.OverflowType
        self._too_much = int(flags.ALL & ~(flags.ITERATIONS | flags.LS_ITERATIONS))
        self._record_step()

    def bind(self, name: str) -> np.ndarray:
        """A field of all simulations, shape (n, size), to be read and written in place between rollouts."""
        return self._host[name]

    def reset(self, *, ids: np.ndarray, stage: Any) -> None:
        """Put some simulations into their initial state; nothing is computed from it (``stage`` is ``mjSTAGE_NONE``)."""
        if stage != mujoco.mjtStage.mjSTAGE_NONE:
            raise NotImplementedError("a reset that computes a stage")
        for name, values in self._host.items():
            values[ids] = self._model.qpos0 if name == "qpos" else 0.0
        self.warning[ids] = 0
        self._forget(ids)

    def forward(self, *, ids: np.ndarray) -> None:
        """Nothing is kept that follows from the states: each step computes it from them. Their solvers begin anew."""
        self._fresh[ids] = True
        self._forget(ids)

    def set_models(self, models: list[mujoco.MjModel] | None) -> None:
        """A model for each simulation; the nominal one for all if None.

        Raises:
            UnvariedFieldError: a model differs in a field that all have in common.
        """
        if models is None and not self._fields:
            self.models = None
            return
        before = self.models or [self._model] * self._n
        wanted = models or [self._model] * self._n
        changed = [row for row in range(self._n) if wanted[row] is not before[row]]
        for row in changed:
            self._check(row, wanted[row])
        if not self._fields:
            self._give_own_fields()
        for row in changed:
            for name, values in self._fields.items():
                values[row] = self._values(wanted[row], name)
        for name in self._fields:
            self._send_field(name)
        self.models = None if models is None else list(models)

    def advance(self, torque_nm: np.ndarray, *, report: bool) -> Rows:
        """As of :class:`PhysicsBatch`; an unstable simulation begins anew from its initial state."""
        host, shape = self._host, torque_nm.shape[:2]
        qpos, qvel, ctrl = (np.empty((*shape, host[name].shape[1])) for name in ("qpos", "qvel", "ctrl"))
        reports = np.empty((*shape, r.REPORT_SIZE)) if report else None
        self._ask_bias()
        with self._warp.ScopedDevice(self._device):
            self._send("qpos", "qvel")
            for step in range(shape[1]):
                qpos[:, step], qvel[:, step], host["ctrl"][:] = host["qpos"], host["qvel"], torque_nm[:, step]
                self._control()
                self._send("ctrl", "qfrc_applied")
                self._launch()
                self._receive()
                ctrl[:, step] = host["ctrl"]
                if reports is not None:
                    reports[:, step] = host["sensordata"]
        return Rows(qpos, qvel, ctrl, reports)

    def _ask_bias(self) -> None:
        """Compute what gravity and motion ask of joints, for friction by the load from outside in the first step of a trial.

        Later steps have it of the step before, from the device.
        """
        loaded = (self._host["userdata"][:, _OUTER_LOAD : _OUTER_LOAD + 9] != 0.0).any(axis=1)
        for row in np.flatnonzero(self._fresh & loaded):
            model = self.models[row] if self.models else self._model
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = self._host["qpos"][row], self._host["qvel"][row]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            self._host["qfrc_bias"][row] = data.qfrc_bias
        self._fresh[:] = False

    def _launch(self) -> None:
        self._warp.capture_launch(self._recorded)

    def _control(self) -> None:
        """Let safety pipeline and effects act on the state of this step."""
        host = self._host
        bounds = np.zeros((self._n, 9))
        states = (host[name] for name in ("qpos", "qvel", "qfrc_bias", "sensordata", "qfrc_applied"))
        numba.set_num_threads(self._threads)
        _controller()(host["userdata"], host["ctrl"], *states, bounds)
        moving = host["userdata"][:, r.BOUNDS_ON] != 0.0
        if moving.any():
            self._fields["dof_frictionloss"][moving, :9] = bounds[moving]
            self._send_field("dof_frictionloss")

    def _receive(self) -> None:
        """Take the state after a step from the device; simulations that became unstable go back to the initial one."""
        data, host = self._data, self._host
        host["qpos"][:], host["qvel"][:] = data.qpos.numpy(), data.qvel.numpy()
        if (host["userdata"][:, _OUTER_LOAD : _OUTER_LOAD + 9] != 0.0).any():
            host["qfrc_bias"][:] = data.qfrc_bias.numpy()
        sums = np.abs(host["qpos"]).max(axis=1) + np.abs(host["qvel"]).max(axis=1)
        lost = ~(sums < LARGEST) | ((data.overflow.numpy() & self._too_much) != 0)
        if lost.any():
            rows = np.flatnonzero(lost)
            host["qpos"][rows], host["qvel"][rows] = self._model.qpos0, 0.0
            self.warning[rows] = 1
            self._forget(rows)
            self._send("qpos", "qvel")

    def _forget(self, rows: np.ndarray) -> None:
        """Let the solver begin without a guess, and forget that there was too little room."""
        for array in (self._data.qacc_warmstart, self._data.overflow):
            values = array.numpy().copy()
            values[rows] = 0
            array.assign(values)

    def _send(self, *names: str) -> None:
        for name in names:
            getattr(self._data, name).assign(self._host[name].astype(np.float32))

    def _owner(self, name: str) -> Any:
        return self._on_device.opt if name == _GRAVITY else self._on_device

    def _values(self, model: mujoco.MjModel, name: str) -> np.ndarray:
        values = model.opt.gravity if name == _GRAVITY else getattr(model, name)
        return np.asarray(values, dtype=np.float32).reshape(self._fields[name].shape[1:])

    def _send_field(self, name: str) -> None:
        getattr(self._owner(name), name).assign(self._fields[name])

    def _give_own_fields(self) -> None:
        """Let each simulation have ``VARIED`` and gravity for itself from now on."""
        for name in (*VARIED, _GRAVITY):
            shared = getattr(self._owner(name), name)
            self._fields[name] = np.repeat(shared.numpy()[:1], self._n, axis=0)
            own = self._warp.array(self._fields[name], dtype=shared.dtype, device=self._device)
            setattr(self._owner(name), name, own)
        self._record_step()

    def _record_step(self) -> None:
        """Record a step to be launched as one: launching its hundred kernels one by one takes fifty times as long."""
        with self._warp.ScopedDevice(self._device):
            self._library.step(self._on_device, self._data)  # loads the kernels
            with self._warp.ScopedCapture(self._device) as capture:
                self._library.step(self._on_device, self._data)
        self._recorded = capture.graph
        self._forget(np.arange(self._n))

    def _check(self, row: int, model: mujoco.MjModel) -> None:
        nominal = self._common_fields
        differs = [name for name, value in nominal.items() if np.asarray(getattr(model, name)).tobytes() != value]
        options = [name for name in _plain_names(model.opt) if name != _GRAVITY]
        differs += [name for name in options if not np.array_equal(getattr(model.opt, name), getattr(self._model.opt, name))]
        if differs:
            raise UnvariedFieldError(row, differs)

    @functools.cached_property
    def _common_fields(self) -> dict[str, bytes]:
        """What all models must have in common, as bytes."""
        names = [name for name in _plain_names(self._model) if name not in (*VARIED, *WITHOUT_MEANING)]
        values = {name: getattr(self._model, name) for name in names}
        return {name: np.asarray(value).tobytes() for name, value in values.items() if isinstance(value, np.ndarray | int)}


def _plain_names(struct: Any) -> list[str]:
    return [name for name in dir(struct) if not name.startswith("_") and not callable(getattr(struct, name))]


def control_rows(
    slots: np.ndarray,
    torque: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    bias: np.ndarray,
    report: np.ndarray,
    force: np.ndarray,
    bounds: np.ndarray,
) -> None:
    """One step of the control of all simulations: ``native_control``'s callback for each row.

    Args:
        slots: their records, shape (n, slots).
        torque: desired torques in, applied torques out, shape (n, 9), N m.
        position: qpos, shape (n, 16).
        velocity: qvel, shape (n, 15).
        bias: what gravity and motion asked of the joints a step before, shape (n, 15), N m.
        report: filled with what is measured, shape (n, 36).
        force: filled with generalised forces to add, shape (n, 15).
        bounds: filled with the bounds of joint friction where they move, shape (n, 9), N m.
    """
    for i in numba.prange(len(slots)):
        if slots[i, r.EFFECTS_ON] == 0.0:
            if slots[i, r.SAFETY_ON] == 1.0:
                protect_nominal(slots[i], torque[i], position[i], velocity[i])
            continue
        step_with_effects(slots[i], torque[i], position[i], velocity[i], report[i], force[i])
        if slots[i, r.BOUNDS_ON] != 0.0:
            set_bounds(slots[i], velocity[i], bias[i], report[i], bounds[i])


@functools.cache
def _controller() -> Callable[..., None]:
    """``control_rows``, compiled once a process."""
    rows = types.float64[:, ::1]
    return compiled_once(lambda cache: numba.njit([(rows,) * 8], cache=cache, parallel=True)(control_rows))
