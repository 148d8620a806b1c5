"""Effects on images, bit for bit as they are written down: however they are computed, old renders and new ones are the same."""

import numpy as np

from sim_backend.effects.looking import blurred, noisy_image

IMAGES = np.random.default_rng(3).uniform(0.0, 255.0, (3, 9, 11, 3)).astype(np.float32)


def test_an_image_out_of_focus_is_its_gaussian_along_both_axes():
    sigma_px = np.array([0.0, 0.7, 1.6])
    wanted = IMAGES.copy()
    for camera in (1, 2):
        reach = int(np.ceil(3.0 * sigma_px[camera]))
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px[camera]) ** 2).astype(np.float32)
        kernel /= kernel.sum()
        for axis in (0, 1):
            padding = [(reach, reach) if each == axis else (0, 0) for each in range(3)]
            padded, length = np.pad(wanted[camera], padding, mode="edge"), IMAGES.shape[1 + axis]
            shifted = [weight * padded.take(range(k, k + length), axis=axis) for k, weight in enumerate(kernel)]
            wanted[camera] = sum(shifted)
    assert blurred(IMAGES, {"sigma_px": sigma_px}, np.random.default_rng(1)).tobytes() == wanted.tobytes()


def test_noise_grows_with_light():
    values = {"reading": np.array([0.0, 0.01, 0.02]), "light": np.array([0.05, 0.0, 0.03])}
    reading, light = (np.square(values[name])[:, None, None, None] for name in ("reading", "light"))
    deviation = np.sqrt((reading + light * (IMAGES / np.float32(255.0))).astype(np.float32))
    drawn = np.random.default_rng(1).standard_normal(IMAGES.shape, dtype=np.float32)
    wanted, before = IMAGES + np.float32(255.0) * deviation * drawn, IMAGES.copy()
    assert noisy_image(IMAGES, values, np.random.default_rng(1)).tobytes() == wanted.tobytes()
    assert np.array_equal(IMAGES, before)
