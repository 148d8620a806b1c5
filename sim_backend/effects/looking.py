"""Effects on what the cameras see: where they stand, light, paint and the images themselves. They change images and nothing else.

None of them touches the pose that the formula reports (``tracking.py``): a robot of a preset without them has the cameras of the
calibration files and the look of the photographs.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_camera, per_face, per_robot
from sim_backend.trifinger import constants as c

if TYPE_CHECKING:
    from mujoco import MjSpec

FACES = tuple(c.CUBE_FACE_COLOURS)
LAMP = "lamp"
FLOOR, WALL = "floor", "wall"
"""Names of the light and of what has one colour in the scene that is rendered (``vision/appearance.py``)."""


def rotation_matrix(rotation_rad: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a rotation vector (3,), rad (Rodrigues)."""
    angle = float(np.linalg.norm(rotation_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = rotation_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def moved_camera(rotation: np.ndarray, translation_m: np.ndarray, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """One camera's rotation (3, 3) and translation (3,) from the world, as it stands and not as its file says.

    It is turned about its own axes (pitch about the image's x, yaw about its y, roll about the optical axis) and then moved along
    those of its file.
    """
    turn = rotation_matrix(np.array([values["pitch_rad"], values["yaw_rad"], values["roll_rad"]]))
    moved_m = np.array([values["right_m"], values["down_m"], values["forward_m"]])
    position_m = rotation.T @ (moved_m - translation_m)
    turned = turn.T @ rotation
    return turned, -turned @ position_m


def other_lens(
    focal_px: tuple[float, float], centre_px: tuple[float, float], values: Mapping[str, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """One camera's focal lengths and centre, px, as it is made and not as its file says."""
    factor = 1.0 + values["focal_error"]
    return (
        (focal_px[0] * factor, focal_px[1] * factor),
        (centre_px[0] + values["centre_x_px"], centre_px[1] + values["centre_y_px"]),
    )


def lamp(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Make the lamp above brighter or darker against the light from everywhere, and lean its direction."""
    for light in spec.lights:
        if light.name == LAMP:
            light.diffuse = np.asarray(light.diffuse) * (1.0 + float(values["strength"]))
            lean = [np.tan(float(values["lean_x_rad"])), np.tan(float(values["lean_y_rad"])), 0.0]
            light.dir = np.asarray(light.dir) + lean


def surroundings(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Other greys of floor and wall."""
    for name in (FLOOR, WALL):
        for geom in spec.geoms:
            if geom.name == f"seen_{name}":
                red, green, blue, alpha = geom.rgba
                factor = 1.0 + float(values[name])
                geom.rgba = [*np.clip([red * factor, green * factor, blue * factor], 0.0, 1.0), alpha]


def face_paint(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Other paint on the faces: hue, saturation and brightness of each."""
    paint = zip(FACES, values["hue_rad"], values["saturation"], values["brightness"], strict=True)
    for face, hue_rad, saturation, brightness in paint:
        geom = spec.geom(f"cube_face_{face}")
        geom.rgba = [*repainted(np.asarray(geom.rgba)[:3], float(hue_rad), float(saturation), float(brightness)), 1.0]


def repainted(rgb: np.ndarray, hue_rad: float, saturation: float, brightness: float) -> np.ndarray:
    """A colour, shape (3,) from 0 to 1, turned about the grey axis, farther from it or nearer, brighter or darker."""
    grey = np.full(3, rgb.mean())
    turned = rotation_matrix(hue_rad * np.full(3, 3**-0.5)) @ (rgb - grey)
    return np.clip((grey + (1.0 + saturation) * turned) * (1.0 + brightness), 0.0, 1.0)


def gloss(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Let the faces of the cube shine: a material with a highlight of that strength."""
    spec.add_material(name="gloss", specular=float(values["strength"]), shininess=0.5, rgba=[1.0, 1.0, 1.0, 1.0])
    for face in FACES:
        geom = spec.geom(f"cube_face_{face}")
        colour = np.asarray(geom.rgba).copy()
        geom.material, geom.rgba = "gloss", colour


def exposed(images: np.ndarray, values: Mapping[str, np.ndarray], _rng: np.random.Generator) -> np.ndarray:
    """Images (3, height, width, 3) of 0 to 255 with more or less light; each stop doubles it."""
    return images * np.exp2(values["stops"]).astype(np.float32)[:, None, None, None]


def white_balanced(images: np.ndarray, values: Mapping[str, np.ndarray], _rng: np.random.Generator) -> np.ndarray:
    """Images (3, height, width, 3; red, green, blue) whose red and blue are weighed another way against green."""
    gains = np.stack([np.exp(values["red"]), np.ones(3), np.exp(values["blue"])], axis=1)
    return images * gains.astype(np.float32)[:, None, None, :]


def blurred(images: np.ndarray, values: Mapping[str, np.ndarray], _rng: np.random.Generator) -> np.ndarray:
    """Images (3, height, width, 3) out of focus: a Gaussian of that many pixels."""
    out = images.copy()
    for camera, sigma_px in enumerate(values["sigma_px"]):
        if sigma_px > 0.0:
            reach = int(np.ceil(3.0 * sigma_px))
            kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2).astype(np.float32)
            kernel /= kernel.sum()
            for axis in (0, 1):
                out[camera] = _convolved(out[camera], kernel, axis)
    return out


def _convolved(image: np.ndarray, kernel: np.ndarray, axis: int) -> np.ndarray:
    """An image (height, width, 3) convolved along an axis; its edge pixels go on outside."""
    reach = len(kernel) // 2
    padding = [(0, 0)] * 3
    padding[axis] = (reach, reach)
    padded, length = np.pad(image, padding, mode="edge"), image.shape[axis]
    out, part = np.zeros_like(image), np.empty_like(image)
    for k, weight in enumerate(kernel):
        shifted = padded[k : k + length] if axis == 0 else padded[:, k : k + length]
        out += np.multiply(shifted, weight, out=part)
    return out


def noisy_image(images: np.ndarray, values: Mapping[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Images (3, height, width, 3) with the noise of light and reading: its variance grows with brightness."""
    noise = rng.standard_normal(images.shape, dtype=np.float32)
    reading, light = np.square(values["reading"]), np.square(values["light"])
    for camera, image in enumerate(images):
        deviation = (reading[camera] + light[camera] * (image / np.float32(255.0)).astype(float)).astype(np.float32)
        np.sqrt(np.maximum(deviation, 0.0, out=deviation), out=deviation)
        noise[camera] *= np.multiply(deviation, np.float32(255.0), out=deviation)
    return np.add(images, noise, out=noise)


_CALIBRATION = "trifinger_simulation data/camera_params: tf_world_to_camera_std; trifinger_object_tracking test/images: likewise"
_TOT = "open-dynamic-robot-initiative/trifinger_object_tracking @78ec981"
_PHOTOS = f"{_TOT} test/images: photographs of two generations of cubes under two lights"
_SETTINGS = "trifinger_cameras config/pylon_camera_settings.txt: exposure of 1.5 ms, gain 0, Bayer pattern"


def _effect(
    name: str,
    about: str,
    source: str,
    acts: Acts,
    apply: Callable[..., Any],
    *parameters: Parameter,
    shape: tuple[Parameter, ...] = (),
) -> Effect:
    return Effect(name, Group.IMAGES, about, source, acts, parameters, apply, shape)


EFFECTS: tuple[Effect, ...] = (
    _effect(
        "camera_pose",
        "a camera stands elsewhere than its calibration file says",
        _CALIBRATION,
        Acts.CALIBRATION,
        moved_camera,
        per_camera("right_m", "m", -0.02, 0.02, 0.0, "along the image's x"),
        per_camera("down_m", "m", -0.02, 0.02, 0.0, "along the image's y"),
        per_camera("forward_m", "m", -0.02, 0.02, 0.0, "along the optical axis"),
        per_camera("pitch_rad", "rad", -0.05, 0.05, 0.0, "about the image's x"),
        per_camera("yaw_rad", "rad", -0.05, 0.05, 0.0, "about the image's y"),
        per_camera("roll_rad", "rad", -0.05, 0.05, 0.0, "about the optical axis"),
    ),
    _effect(
        "camera_lens",
        "a camera's lens differs from its calibration file",
        f"{_CALIBRATION}; focal lengths of the two sets of files differ by up to 0.3 %",
        Acts.CALIBRATION,
        other_lens,
        per_camera("focal_error", "", -0.05, 0.05, 0.0, "of both focal lengths"),
        per_camera("centre_x_px", "px", -10.0, 10.0, 0.0, "in images of 270 pixels"),
        per_camera("centre_y_px", "px", -10.0, 10.0, 0.0, "in images of 270 pixels"),
    ),
    _effect(
        "lamp",
        "the light from above is stronger, weaker or comes from a side",
        _PHOTOS,
        Acts.APPEARANCE,
        lamp,
        per_robot("strength", "", -0.9, 1.0, 0.0, "of the lamp, as a share; light from everywhere stays"),
        per_robot("lean_x_rad", "rad", -1.0, 1.0, 0.0, "of the lamp's direction, towards x"),
        per_robot("lean_y_rad", "rad", -1.0, 1.0, 0.0, "of the lamp's direction, towards y"),
    ),
    _effect(
        "surroundings",
        "floor and wall have another grey",
        _PHOTOS,
        Acts.APPEARANCE,
        surroundings,
        per_robot(FLOOR, "", -0.8, 2.0, 0.0, "brightness, as a share"),
        per_robot(WALL, "", -0.8, 1.0, 0.0, "brightness, as a share"),
    ),
    _effect(
        "face_paint",
        "the cube's faces have other paint",
        _PHOTOS,
        Acts.APPEARANCE,
        face_paint,
        per_face("hue_rad", "rad", -0.6, 0.6, 0.0, "turn about the grey axis"),
        per_face("saturation", "", -0.8, 0.8, 0.0, "distance from grey, as a share"),
        per_face("brightness", "", -0.8, 0.8, 0.0, "as a share"),
    ),
    _effect(
        "gloss",
        "the cube's faces reflect the lamp",
        _PHOTOS,
        Acts.APPEARANCE,
        gloss,
        per_robot("strength", "", 0.0, 1.0, 0.0, "of the highlight"),
    ),
    _effect(
        "exposure",
        "a camera takes more light, or less",
        _SETTINGS,
        Acts.IMAGE,
        exposed,
        per_camera("stops", "", -3.0, 3.0, 0.0, "each doubles the light"),
    ),
    _effect(
        "white_balance",
        "a camera weighs red and blue another way",
        _SETTINGS,
        Acts.IMAGE,
        white_balanced,
        per_camera("red", "", -0.7, 0.7, 0.0, "logarithm of the gain of red over green"),
        per_camera("blue", "", -0.7, 0.7, 0.0, "logarithm of the gain of blue over green"),
    ),
    _effect(
        "image_blur",
        "a camera is out of focus",
        _PHOTOS,
        Acts.IMAGE,
        blurred,
        per_camera("sigma_px", "px", 0.0, 4.0, 0.0, "standard deviation in images of 270 pixels"),
    ),
    _effect(
        "image_noise",
        "every image has noise of its own",
        _SETTINGS,
        Acts.IMAGE,
        noisy_image,
        per_camera("reading", "", 0.0, 0.1, 0.0, "standard deviation in the dark, as a share of white"),
        per_camera("light", "", 0.0, 0.2, 0.0, "standard deviation that full light adds, as a share of white"),
    ),
)
