"""A robot's three cameras: its scene as they take it, with their lenses, calibration errors and the faults of their images.

MuJoCo's renderer paints an image without distortion that is wider than the camera's; a table made once says where in it each
pixel of the camera's image lies. It needs EGL (in software where there is no GPU) and the extra ``vision``.
"""

from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.looking import FACES
from sim_backend.effects.physics import Physics
from sim_backend.extras import how_to_install
from sim_backend.trifinger.objects import CUBE, Shape
from sim_backend.vision.appearance import seen_spec
from sim_backend.vision.calibration import Calibration, nominal_calibrations
from sim_backend.vision.pictures import opencv

SUPERSAMPLING = 2
"""Rendered pixels along each edge of an image's pixel; their mean is taken, as a sensor takes it."""
_MARGIN = 1.01
_CLIP_M = (0.05, 3.0)
EXTRA = f"{how_to_install('vision')}; and EGL (apt-get install libegl1 libgl1-mesa-dri renders in software)"


class CamerasMissingError(RuntimeError):
    """This machine cannot render; the message says what to install."""


class Cameras:
    """The three cameras of one robot; a context manager, which owns the renderer. Not for use after a fork.

    Args:
        physics: of one robot (n = 1); effects on images are those in ``LOOKS``, and sizes are those of its model.
        shape: the object in the arena.
        calibrations: where the cameras stand by their files; the nominal ones if None. Images have their sizes.

    Raises:
        CamerasMissingError: the machine cannot render.
    """

    def __init__(
        self, physics: Physics | None = None, *, shape: Shape = CUBE, calibrations: Sequence[Calibration] | None = None
    ) -> None:
        self._physics = Physics.nominal() if physics is None else physics
        self.true_calibrations = tuple(
            as_it_stands(each, self._physics, index) for index, each in enumerate(calibrations or nominal_calibrations())
        )
        self._pinholes = [_Pinhole(each) for each in self.true_calibrations]
        spec = seen_spec(self._physics, shape=shape)
        size_px = max(pinhole.size_px for pinhole in self._pinholes)
        spec.visual.quality.offsamples = 0
        spec.visual.global_.offwidth = spec.visual.global_.offheight = size_px
        for pinhole in self._pinholes:
            pinhole.add_to(spec)
        self._model = spec.compile()
        self._model.vis.map.znear, self._model.vis.map.zfar = (edge / self._model.stat.extent for edge in _CLIP_M)
        self._data = mujoco.MjData(self._model)
        self._image_effects = [
            (effect.apply, {p.name: self._physics.value(effect.key(p))[0] for p in effect.all_parameters})
            for effect in CATALOGUE.values()
            if effect.acts is Acts.IMAGE and self._physics.has(effect.name)
        ]
        self._painter = _Painter(self._model, size_px)

    def __enter__(self) -> "Cameras":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Give the renderer back."""
        self._painter.close()

    def take(
        self,
        joint_position_rad: np.ndarray,
        cube_position_world_m: np.ndarray,
        cube_quat_wxyz: np.ndarray,
        *,
        seed: int = 0,
        frame: int = 0,
    ) -> np.ndarray:
        """One exposure of all three cameras.

        Args:
            joint_position_rad: true joint positions, shape (9,).
            cube_position_world_m: the object's true position, shape (3,).
            cube_quat_wxyz: shape (4,).
            seed: of the robot's noise in this trial.
            frame: number of the exposure; the same seed and frame give the same bits.

        Returns:
            Images, shape (3, height, width, 3), uint8, red first, in the order of ``constants.CAMERAS``.
        """
        self._place(joint_position_rad, cube_position_world_m, cube_quat_wxyz)
        images = np.stack(
            [pinhole.seen(self._painter.paint(self._data, at, pinhole.size_px)) for at, pinhole in enumerate(self._pinholes)]
        )
        if self._image_effects:
            rng = np.random.default_rng([seed, frame + 2**20])  # frames before the start are negative
            for apply, values in self._image_effects:
                images = apply(images, values, rng)
        return np.clip(np.rint(images), 0, 255).astype(np.uint8)

    def labels(self, joint_position_rad: np.ndarray, cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> np.ndarray:
        """Which face of the object each pixel of :meth:`take` shows: 0 for none, else its place in ``CUBE_FACE_COLOURS`` plus 1.

        Returns:
            Shape (3, height, width), uint8.
        """
        self._place(joint_position_rad, cube_position_world_m, cube_quat_wxyz)
        face_of = np.zeros(self._model.ngeom + 1, np.uint8)  # the last is of pixels without a geom
        for number, face in enumerate(FACES, 1):
            face_of[mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_GEOM, f"cube_face_{face}")] = number
        painted = [self._painter.paint_geoms(self._data, at, each.size_px) for at, each in enumerate(self._pinholes)]
        return np.stack([pinhole.nearest(face_of[geoms]) for pinhole, geoms in zip(self._pinholes, painted, strict=True)])

    def _place(self, joint_position_rad: np.ndarray, cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> None:
        self._data.qpos[:9] = joint_position_rad
        self._data.qpos[9:12], self._data.qpos[12:16] = cube_position_world_m, cube_quat_wxyz
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)


def as_it_stands(calibration: Calibration, physics: Physics, camera: int) -> Calibration:
    """A camera's calibration as it truly is on one robot (n = 1), with its effects of ``Acts.CALIBRATION``."""
    pose, lens = (CATALOGUE[name] for name in ("camera_pose", "camera_lens"))
    if physics.has(pose.name):
        values = {p.name: float(physics.value(pose.key(p))[0, camera]) for p in pose.all_parameters}
        rotation, translation_m = pose.apply(calibration.rotation, calibration.translation_m, values)
        calibration = replace(calibration, rotation=rotation, translation_m=translation_m)
    if physics.has(lens.name):
        values = {p.name: float(physics.value(lens.key(p))[0, camera]) for p in lens.all_parameters}
        focal_px, centre_px = lens.apply(calibration.focal_px, calibration.centre_px, values)
        calibration = replace(calibration, focal_px=focal_px, centre_px=centre_px)
    return calibration


class _Pinhole:
    """What MuJoCo renders for one camera, a wider image without distortion, and the table that makes the camera's image of it."""

    def __init__(self, calibration: Calibration) -> None:
        self._name, self._rotation, self._position_m = calibration.name, calibration.rotation, calibration.position_world_m
        fine = calibration.resized(SUPERSAMPLING * calibration.size_px[0])
        columns, rows = np.meshgrid(np.arange(fine.size_px[0]), np.arange(fine.size_px[1]))
        direction = fine.normalised(np.stack([columns, rows], axis=-1))
        half = _MARGIN * float(np.abs(direction).max())
        self.size_px = int(np.ceil(2 * half * max(fine.focal_px)))
        self._half = half
        table = (direction / half * (self.size_px / 2) + (self.size_px / 2 - 0.5)).astype(np.float32)
        self._table = [np.ascontiguousarray(table[..., axis]) for axis in (0, 1)]

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add the camera that is rendered; MuJoCo's look along their -z with y up."""
        axes = np.stack([self._rotation[0], -self._rotation[1], -self._rotation[2]], axis=1)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(axes).ravel())
        opening_deg = float(np.rad2deg(2 * np.arctan(self._half)))
        spec.worldbody.add_camera(name=self._name, pos=self._position_m, quat=quat, fovy=opening_deg)

    def seen(self, painted: np.ndarray) -> np.ndarray:
        """The camera's image, shape (height, width, 3), float32, of the rendered one, shape (size, size, 3), uint8."""
        cv2 = opencv()
        fine = cv2.remap(painted, *self._table, cv2.INTER_LINEAR)
        height, width = fine.shape[0] // SUPERSAMPLING, fine.shape[1] // SUPERSAMPLING
        return cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)

    def nearest(self, painted: np.ndarray) -> np.ndarray:
        """Numbers of the camera's pixels, shape (height, width), of the rendered ones, shape (size, size), without a mixture."""
        fine = opencv().remap(painted, *self._table, opencv().INTER_NEAREST)
        return fine[::SUPERSAMPLING, ::SUPERSAMPLING]


class _Painter:
    """MuJoCo's renderer on a context of its own without a window."""

    def __init__(self, model: mujoco.MjModel, size_px: int) -> None:
        self._model, self._context = model, _context(size_px)
        self._context.make_current()
        self._gpu: mujoco.MjrContext | None = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._gpu)
        self._scene, self._option = mujoco.MjvScene(model, maxgeom=400), mujoco.MjvOption()
        self._option.geomgroup[:] = [1, 1, 1, 0, 0, 0]
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_SKYBOX):
            self._scene.flags[flag] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def paint(self, data: mujoco.MjData, camera: int, size_px: int) -> np.ndarray:
        """What a camera of the model sees, shape (size, size, 3), uint8, top row first."""
        return self._painted(data, camera, size_px)

    def paint_geoms(self, data: mujoco.MjData, camera: int, size_px: int) -> np.ndarray:
        """Which geom of the model a camera sees, shape (size, size), top row first; -1 for none."""
        flags = (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)
        for flag in flags:
            self._scene.flags[flag] = 1
        pixels = self._painted(data, camera, size_px).astype(np.int32)
        for flag in flags:
            self._scene.flags[flag] = 0
        shown = pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2]  # 0 for none, else the place in the scene plus 1
        geom_of = np.full(self._scene.ngeom + 1, -1)
        for place in range(self._scene.ngeom):
            each = self._scene.geoms[place]
            if each.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                geom_of[each.segid + 1] = each.objid
        return geom_of[shown]

    def _painted(self, data: mujoco.MjData, camera: int, size_px: int) -> np.ndarray:
        assert self._gpu is not None, "closed"
        self._context.make_current()
        self._camera.fixedcamid = camera
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, everything, self._scene)
        viewport, pixels = mujoco.MjrRect(0, 0, size_px, size_px), np.empty((size_px, size_px, 3), np.uint8)
        mujoco.mjr_render(viewport, self._scene, self._gpu)
        mujoco.mjr_readPixels(pixels, None, viewport, self._gpu)
        return np.ascontiguousarray(pixels[::-1])

    def close(self) -> None:
        if self._gpu is not None:
            self._context.make_current()
            self._gpu.free()
            self._context.free()
            self._gpu = None


def _context(size_px: int) -> Any:
    """A context of EGL, whatever ``MUJOCO_GL`` says: only there can a machine without a screen render.

    Raises:
        CamerasMissingError: the machine cannot.
    """
    try:
        opencv()
        import mujoco.egl

        return mujoco.egl.GLContext(size_px, size_px)
    except (ImportError, AttributeError, RuntimeError) as error:
        raise CamerasMissingError(f"images cannot be rendered here ({error}); needed: {EXTRA}") from error
