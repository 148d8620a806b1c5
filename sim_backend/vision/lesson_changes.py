"""How crops of renders are changed whenever they are shown to the network, so that photographs are one more change to it.

Every function takes and gives images (n, 3, height, width) of 0 to 1, red first, and classes of pixels (n, height, width).
"""

import torch
from torch.nn import functional

from sim_backend.vision.seen_pixels import CLASSES

MOST_VIVID, HUE_RAD = 2.2, 0.12
"""Of a face's paint: saturation as a multiple of the render's, and the standard deviation of its turn about the grey axis."""


def changed(
    image: torch.Tensor, face: torch.Tensor, place: torch.Tensor, rng: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """All changes, each with its probability: paint and light of faces, backgrounds, things before the cube, the camera.

    Args:
        image: shape (n, 3, height, width), 0 to 1.
        face: classes, shape (n, height, width).
        place: on the cube, shape (n, 3, height, width), -1 to 1.
        rng: where chance comes from.
    """
    image = _repainted(image, face, place, rng)
    image = _other_background(image, face, rng)
    if _likely(rng, 0.7):
        image, face = _something_before(image, face, rng)
    return _taken(image, rng).clamp(0.0, 1.0), face


def _likely(rng: torch.Generator, chance: float) -> bool:
    """Whether something happens to a whole batch: what is left out for all of it costs nothing."""
    return torch.rand((), generator=rng).item() < chance


def _normal(rng: torch.Generator, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=rng)


def _uniform(rng: torch.Generator, low: float, high: float, *shape: int) -> torch.Tensor:
    return low + (high - low) * torch.rand(*shape, generator=rng)


def _repainted(image: torch.Tensor, face: torch.Tensor, place: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Each face brighter or darker, of other hue and saturation, and with light that differs across it.

    Paint and print differ, and cameras have colour matrices of their own: green has been seen with next to no blue in it.
    """
    n = len(image)
    gain = torch.exp(0.25 * _normal(rng, n, 1, CLASSES) + 0.1 * _normal(rng, n, 3, CLASSES))
    gain[:, :, 0] = 1.0
    saturation, hue_rad = _uniform(rng, 0.5, MOST_VIVID, n, CLASSES), HUE_RAD * _normal(rng, n, CLASSES)
    saturation[:, 0], hue_rad[:, 0] = 1.0, 0.0
    index = face.long().flatten(1)
    by_pixel = gain.gather(2, index[:, None].expand(-1, 3, -1)).view_as(image)
    vivid = saturation.gather(1, index).view_as(face)[:, None]
    slope = 0.12 * _normal(rng, n, 3, 1, 1)
    across = 1.0 + (slope * place).sum(dim=1, keepdim=True)
    grey, turn = image.mean(dim=1, keepdim=True), hue_rad.gather(1, index).view_as(face)[:, None]
    return (grey + vivid * _turned(image - grey, turn)) * by_pixel * across


def _turned(colour: torch.Tensor, angle_rad: torch.Tensor) -> torch.Tensor:
    """Colours without their grey, shape (n, 3, ...), turned about the grey axis: by Rodrigues' formula."""
    red, green, blue = colour.unbind(dim=1)
    across = torch.stack([blue - green, red - blue, green - red], dim=1) * 3**-0.5
    return colour * torch.cos(angle_rad) + across * torch.sin(angle_rad)


def _texture(rng: torch.Generator, n: int, height: int, width: int) -> torch.Tensor:
    """Smooth random colours, shape (n, 3, height, width)."""
    coarse = torch.rand(n, 3, 6, 6, generator=rng)
    grey = torch.rand(n, 1, 6, 6, generator=rng)
    mixed = grey + _uniform(rng, 0.0, 1.0, n, 1, 1, 1) * (coarse - grey)
    return functional.interpolate(mixed, size=(height, width), mode="bilinear")


def _other_background(image: torch.Tensor, face: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Another brightness and tint of all that is not the cube, and sometimes other things in it."""
    n, _, height, width = image.shape
    other = image * torch.exp(0.3 * _normal(rng, n, 1, 1, 1) + 0.06 * _normal(rng, n, 3, 1, 1))
    if _likely(rng, 0.5):
        blend = _uniform(rng, 0.0, 0.8, n, 1, 1, 1) * (torch.rand(n, 1, 1, 1, generator=rng) < 0.7)
        spots = functional.interpolate(torch.rand(n, 1, 5, 5, generator=rng), size=(height, width), mode="bilinear") > 0.6
        other = torch.where(spots, other + blend * (_texture(rng, n, height, width) - other), other)
    return torch.where((face == 0)[:, None], other, image)


def _something_before(image: torch.Tensor, face: torch.Tensor, rng: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Bars and discs before everything, most of them without colour, as links, cables and hands are."""
    n, _, height, width = image.shape
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    for _ in range(1 + _likely(rng, 0.5)):
        at = _uniform(rng, 20.0, width - 20.0, n, 2, 1, 1)
        angle, reach = _uniform(rng, 0.0, 3.1416, n, 1, 1), _uniform(rng, 0.0, 50.0, n, 1, 1)
        along = (columns - at[:, 0]) * torch.cos(angle) + (rows - at[:, 1]) * torch.sin(angle)
        across = (rows - at[:, 1]) * torch.cos(angle) - (columns - at[:, 0]) * torch.sin(angle)
        beyond = (along.abs() - reach).clamp(min=0.0)
        inside = beyond**2 + across**2 < _uniform(rng, 2.0, 11.0, n, 1, 1) ** 2
        inside &= torch.rand(n, 1, 1, generator=rng) < 0.4
        grey = torch.rand(n, 1, 1, 1, generator=rng)
        colour = grey + _uniform(rng, 0.0, 0.25, n, 1, 1, 1) * _normal(rng, n, 3, 1, 1)
        image = torch.where(inside[:, None], colour.expand_as(image), image)
        face = torch.where(inside, torch.zeros_like(face), face)
    return image, face


def _taken(image: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Exposure, white balance, contrast, saturation, blur and noise of the camera."""
    n = len(image)
    gain = torch.exp2(0.35 * _normal(rng, n, 1, 1, 1)) * torch.exp(0.08 * _normal(rng, n, 3, 1, 1))
    image = (image * gain).clamp(1e-3, 1.0) ** torch.exp(0.15 * _normal(rng, n, 1, 1, 1))
    grey = image.mean(dim=1, keepdim=True)
    image = grey + _uniform(rng, 0.7, 1.3, n, 1, 1, 1) * (image - grey) + _uniform(rng, -0.03, 0.05, n, 1, 1, 1)
    if _likely(rng, 0.7):
        softer = functional.avg_pool2d(functional.pad(image, (1, 1, 1, 1), mode="replicate"), 3, 1)
        image = image + _uniform(rng, -0.4, 1.0, n, 1, 1, 1) * (softer - image)
    if _likely(rng, 0.7):
        image = image + _uniform(rng, 0.0, 0.04, n, 1, 1, 1) * _normal(rng, *image.shape)
    return image
