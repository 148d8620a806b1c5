"""The network of the tracker on images while it learns (torch): which face a pixel shows, and where on the cube that is.

A small U: three halvings, three doublings, and 11 numbers at every second pixel: logits of background and six faces, the place
on the cube in half its width, and the logarithm of the place's expected error. Robots have no torch; they run its ONNX form
(``seen_pixels.py``).
"""

import torch
from torch import nn
from torch.nn import functional

from sim_backend.vision.seen_pixels import CLASSES, STRIDE

WIDTHS = (16, 32, 64, 96)
OUTPUTS = CLASSES + 3 + 1


def _conv(inputs: int, outputs: int, *, stride: int = 1, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class TrackerNetwork(nn.Module):
    """Takes images (n, 3, height, width), red first, 0 to 1, sizes multiples of 16.

    Out come (n, ``OUTPUTS``, height / 2, width / 2).
    """

    def __init__(self) -> None:
        super().__init__()
        one, two, three, four = WIDTHS
        self.down = nn.ModuleList(
            [
                nn.Sequential(_conv(3, one, stride=STRIDE, size=5)),
                nn.Sequential(_conv(one, two, stride=2), _conv(two, two)),
                nn.Sequential(_conv(two, three, stride=2), _conv(three, three), _conv(three, three)),
                nn.Sequential(_conv(three, four, stride=2), _conv(four, four), _conv(four, four)),
            ]
        )
        self.up = nn.ModuleList([_conv(four, three, size=1), _conv(three, two, size=1), _conv(two, one, size=1)])
        self.join = nn.ModuleList([_conv(three, three), _conv(two, two), _conv(one, one)])
        self.last = nn.Conv2d(one, OUTPUTS, 3, padding=1)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Logits and places; see the class."""
        skipped, x = [], (images - 0.4) * 4.0
        for stage in self.down:
            x = stage(x)
            skipped.append(x)
        for narrow, join, skip in zip(self.up, self.join, skipped[-2::-1], strict=True):
            x = join(functional.interpolate(narrow(x), scale_factor=2.0, mode="nearest") + skip)
        return self.last(x)


def loss_of(output: torch.Tensor, face: torch.Tensor, place: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """What is minimised.

    Args:
        output: of the network, shape (n, ``OUTPUTS``, h, w).
        face: classes, shape (n, h, w); those below 0 do not count.
        place: on the cube, shape (n, 3, h, w), -1 to 1.

    Returns:
        The loss; the share of the cube's pixels whose face is right; their places' mean error in half the cube's width.
    """
    output = output.float()
    logits, found, log_error = output[:, :CLASSES], output[:, CLASSES : CLASSES + 3], output[:, -1].clamp(-5.0, 2.0)
    classes = functional.cross_entropy(logits, face.long(), ignore_index=-1)
    shown = face > 0
    apart = torch.linalg.vector_norm(found - place, dim=1)[shown]
    errors = log_error[shown]
    places = (apart * torch.exp(-errors) + 3.0 * errors).mean()
    right = (logits.argmax(dim=1) == face)[shown].float().mean()
    return 5.0 * classes + 0.2 * places + apart.mean(), right.detach(), apart.mean().detach()
