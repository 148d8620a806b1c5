"""One training of the tracker's network: crops in, epochs with checkpoints, an ONNX graph out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import nn
from torch.nn import functional

from sim_backend.vision.lesson_changes import changed
from sim_backend.vision.seen_pixels import STRIDE
from sim_backend.vision.tracker_network import TrackerNetwork, loss_of

BATCH, RATE, SHOWN_PX = 32, 4e-3, 96
RATE_AGAIN, NORMALISED_BY = 1.5e-3, 256
"""Of a training that begins with a trained network, and how many crops tell what its layers see."""


class Training:
    """A training under way, gone on with from its checkpoint if there is one.

    Args:
        files: of crops to learn from (``lessons.py``).
        held_out: of crops that only tell how well it does.
        checkpoint: where it is kept after each epoch.
        epochs: how many there will be; the learning rate falls to nothing over them, or over what is left of another number.
        seed: of the weights and of all chance.
        begin: an exported network whose weights it begins with, instead of chance.
    """

    def __init__(
        self,
        files: Sequence[Path],
        held_out: Sequence[Path],
        checkpoint: Path,
        *,
        epochs: int,
        seed: int = 1,
        begin: Path | None = None,
    ) -> None:
        torch.manual_seed(seed)
        self._crops, self._held_out, self._checkpoint, self._epochs = crops_of(files), crops_of(held_out), checkpoint, epochs
        self.network = TrackerNetwork().to(memory_format=torch.channels_last)  # pyrefly: ignore[no-matching-overload]
        rate = RATE if begin is None else RATE_AGAIN
        self._optimiser = torch.optim.AdamW(self.network.parameters(), lr=rate, weight_decay=1e-4)
        self.epoch, self.told, self._seed = 0, list[dict[str, float]](), seed
        kept: dict[str, Any] | None = torch.load(checkpoint, weights_only=False) if checkpoint.exists() else None
        if kept is not None:
            self.network.load_state_dict(kept["network"])
            self.epoch, self.told = kept["epoch"], kept["told"]
        elif begin is not None:
            take_weights(self.network, begin)
            self._normalise()
        steps = max(epochs - self.epoch, 1) * (len(self._crops["face"]) // BATCH)
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(self._optimiser, rate, total_steps=steps + 1, pct_start=0.15)
        if kept is not None and kept["epochs"] == epochs:
            self._optimiser.load_state_dict(kept["optimiser"])
            self._schedule.load_state_dict(kept["schedule"])

    def _normalise(self) -> None:
        """Have the layers that normalise know what they see, and give what they gave before."""
        rng = torch.Generator().manual_seed(self._seed)
        image, _, _ = shown(self._crops, torch.randperm(len(self._crops["face"]), generator=rng)[:NORMALISED_BY], rng)
        seen: dict[nn.Module, torch.Tensor] = {}
        layers = [each for each in self.network.modules() if isinstance(each, nn.BatchNorm2d)]

        def keep(layer: nn.Module, given: tuple[torch.Tensor, ...]) -> None:
            seen[layer] = given[0]

        hooks = [each.register_forward_pre_hook(keep) for each in layers]
        self.network.eval()
        with torch.no_grad():
            self.network(image)
            for each in layers:
                assert each.running_mean is not None and each.running_var is not None, "it keeps them"
                variance, mean = torch.var_mean(seen[each], dim=(0, 2, 3))
                each.running_mean.copy_(mean)
                each.running_var.copy_(variance)
                each.bias.add_(mean)
                each.weight.copy_(torch.sqrt(variance + each.eps))
        for hook in hooks:
            hook.remove()

    def learn(self) -> dict[str, float]:
        """One epoch; returns how well it does on crops of robots that it does not learn from."""
        rng = torch.Generator().manual_seed(self._seed + 1000 * self.epoch)
        self.network.train()
        order, total = torch.randperm(len(self._crops["face"]), generator=rng), 0.0
        batches = [rows for rows in order.split(BATCH) if len(rows) == BATCH]
        for rows in batches:
            image, face, place = shown(self._crops, rows, rng)
            self._optimiser.zero_grad()
            with torch.autocast("cpu", torch.bfloat16):
                output = self.network(image.contiguous(memory_format=torch.channels_last))
            loss, _, _ = loss_of(output, face, place)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
            self._optimiser.step()
            self._schedule.step()
            total += loss.item()
        self.epoch += 1
        told = {"epoch": self.epoch, "loss": round(total / len(batches), 4), **self.judged()}
        self.told.append(told)
        kept = {"network": self.network.state_dict(), "optimiser": self._optimiser.state_dict()}
        kept |= {"schedule": self._schedule.state_dict(), "epoch": self.epoch, "epochs": self._epochs, "told": self.told}
        torch.save(kept, self._checkpoint)
        return told

    def judged(self) -> dict[str, float]:
        """Share of faces that are right and mean error of places, on crops held out and not changed."""
        self.network.eval()
        rights, errors = [], []
        with torch.no_grad():
            for rows in torch.arange(len(self._held_out["face"])).split(BATCH):
                image, face, place = shown(self._held_out, rows, None)
                _, right, error = loss_of(self.network(image), face, place)
                rights.append(float(right))
                errors.append(float(error))
        return {"held_out_face": round(float(np.nanmean(rights)), 4), "held_out_place": round(float(np.nanmean(errors)), 4)}

    def export(self, path: Path) -> None:
        """Write the network as ONNX, for images of any size and number."""
        self.network.eval()
        sizes = {0: "images", 2: "height", 3: "width"}
        torch.onnx.export(
            self.network.to(memory_format=torch.contiguous_format),
            (torch.zeros(1, 3, 272, 272),),
            str(path),
            input_names=["images"],
            output_names=["pixels"],
            dynamic_axes={"images": sizes, "pixels": sizes},
            dynamo=False,
        )


def take_weights(network: TrackerNetwork, path: Path) -> None:
    """Give a network the weights of an exported one, in which normalisation is part of the convolutions before it.

    Raises:
        ValueError: that one has other layers.
    """
    kept = [onnx.numpy_helper.to_array(each) for each in onnx.load(path).graph.initializer]
    last, folded = kept[:2], kept[2:]
    parts = [*network.down, *(each for pair in zip(network.up, network.join, strict=True) for each in pair)]  # as they are used
    every = [each for part in parts for each in part.modules()]
    stages = [each for each in every if isinstance(each, nn.Sequential) and isinstance(each[0], nn.Conv2d)]
    if len(folded) != 2 * len(stages):
        raise ValueError(f"{path} has {len(folded) // 2} folded layers, the network has {len(stages)}")
    with torch.no_grad():
        for stage, weight, bias in zip(stages, folded[::2], folded[1::2], strict=True):
            convolution, norm = stage[0], stage[1]
            assert isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d) and norm.running_var is not None
            convolution.weight.copy_(torch.tensor(weight))
            norm.bias.copy_(torch.tensor(bias))
            norm.weight.copy_(torch.sqrt(norm.running_var + norm.eps))
        assert network.last.bias is not None, "it has one"
        network.last.weight.copy_(torch.tensor(last[0]))
        network.last.bias.copy_(torch.tensor(last[1]))


def crops_of(files: Sequence[Path]) -> dict[str, np.ndarray]:
    """The crops of all files, as ``lessons.render_robot`` gives them."""
    loaded = [np.load(file) for file in files]
    return {key: np.concatenate([each[key] for each in loaded]) for key in ("image", "face", "place")}


def shown(
    crops: dict[str, np.ndarray], rows: torch.Tensor, rng: torch.Generator | None
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Crops as the network sees them and what it should say: images, classes (-1 where nobody can tell) and places.

    Args:
        crops: all of them.
        rows: which, shape (n,).
        rng: of their changes; None for the middle of each without any.
    """
    size = crops["face"].shape[1]
    spare = size - SHOWN_PX
    top, left = (spare // 2, spare // 2) if rng is None else torch.randint(0, spare + 1, (2,), generator=rng).tolist()
    window = slice(top, top + SHOWN_PX), slice(left, left + SHOWN_PX)
    at = rows.numpy()
    image = torch.from_numpy(crops["image"][at][:, *window]).permute(0, 3, 1, 2).float() / 255.0
    face = torch.from_numpy(crops["face"][at][:, *window]).long()
    place = torch.from_numpy(crops["place"][at][:, *window]).permute(0, 3, 1, 2).float() / 127.0
    beside = functional.max_pool2d((face > 0).float()[:, None], 3, 1, 1)[:, 0] > 0.0
    unsure = beside & (face == 0)
    if rng is not None:
        image, face = changed(image, face, place, rng)
    wanted = torch.where(unsure, torch.full_like(face, -1), face)
    return image, wanted[:, ::STRIDE, ::STRIDE], place[:, :, ::STRIDE, ::STRIDE]
