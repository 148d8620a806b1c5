"""One training of the tracker's network: crops in, epochs with checkpoints, an ONNX graph out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from sim_backend.vision.lesson_changes import changed
from sim_backend.vision.seen_pixels import STRIDE
from sim_backend.vision.tracker_network import TrackerNetwork, loss_of

BATCH, RATE, SHOWN_PX = 32, 4e-3, 96


class Training:
    """A training under way, gone on with from its checkpoint if there is one.

    Args:
        files: of crops to learn from (``lessons.py``).
        held_out: of crops that only tell how well it does.
        checkpoint: where it is kept after each epoch.
        epochs: how many there will be; the learning rate falls to nothing over them, or over what is left of another number.
        seed: of the weights and of all chance.
    """

    def __init__(self, files: Sequence[Path], held_out: Sequence[Path], checkpoint: Path, *, epochs: int, seed: int = 1) -> None:
        torch.manual_seed(seed)
        self._crops, self._held_out, self._checkpoint, self._epochs = crops_of(files), crops_of(held_out), checkpoint, epochs
        self.network = TrackerNetwork().to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self._optimiser = torch.optim.AdamW(self.network.parameters(), lr=RATE, weight_decay=1e-4)
        self.epoch, self.told, self._seed = 0, list[dict[str, float]](), seed
        kept: dict[str, Any] | None = torch.load(checkpoint, weights_only=False) if checkpoint.exists() else None
        if kept is not None:
            self.network.load_state_dict(kept["network"])
            self.epoch, self.told = kept["epoch"], kept["told"]
        steps = max(epochs - self.epoch, 1) * (len(self._crops["face"]) // BATCH)
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(self._optimiser, RATE, total_steps=steps + 1, pct_start=0.15)
        if kept is not None and kept["epochs"] == epochs:
            self._optimiser.load_state_dict(kept["optimiser"])
            self._schedule.load_state_dict(kept["schedule"])

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
            self.network.to(memory_format=torch.contiguous_format),  # pyright: ignore[reportCallIssue]
            (torch.zeros(1, 3, 272, 272),),
            str(path),
            input_names=["images"],
            output_names=["pixels"],
            dynamic_axes={"images": sizes, "pixels": sizes},
            dynamo=False,
        )


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
