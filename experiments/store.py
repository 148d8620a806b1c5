"""Results on disk, each written at once when it is there and small enough to be committed. Owner of their names.

OUT/NAME/runs/CELL-seed1.json          a finished training: settings, thinned curve, evaluations, digest of the policy
OUT/NAME/runs/CELL-seed1.safetensors   its policy, where it is small, with the manifest as CELL-seed1.manifest.json
OUT/NAME/trials/CELL-seed1-real.json   farm trials, block by block
OUT/NAME/measured/CELL-seed1-real.json what was measured in simulation
OUT/NAME/set-aside/WHY/...             the same of another version or design, which does not count

All say what made them, runs also what they went on from. What was made by another design than the present one, or by two
versions, is refused where it is read, as are runs that went on from two trainings of one start.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments import agreement
from experiments.design import Cell, Experiment, Start
from experiments.kept_versions import KeptVersions
from experiments.recipe_files import start_name
from experiments.result_files import MEASURED, TRIALS, Key, ResultFiles, StoreError

LARGEST_WEIGHTS = 300_000
"""Bytes; larger policies stay in the work folder."""
CURVE_POINTS = 60


@dataclass(frozen=True)
class Store:
    """The results of one experiment below ``out``, the folder of what is not committed, and where its page goes."""

    out: Path
    work: Path
    experiment: Experiment
    pages: Path | None = None
    """Folder of page and figure; beside the results if None."""

    @property
    def folder(self) -> Path:
        """Of the results."""
        return self.out / self.experiment.name

    @property
    def files(self) -> ResultFiles:
        """Its results as they lie there."""
        return ResultFiles(self.folder, self.experiment)

    @property
    def versions(self) -> KeptVersions:
        """Of trials and measurements."""
        return KeptVersions(self.files)

    def run(self, cell: Cell, seed: int) -> dict[str, Any] | None:
        """A finished training, wherever its experiment keeps it.

        Raises:
            StoreError: it is of another recipe.
        """
        path = self._runs(cell) / f"{self._run_stem(cell, seed)}.json"
        if (kept := self.files.read(path)) is not None:
            self._refuse(path, agreement.of_run(kept, cell, seed), f"{path.stem}* there and in trials and measured beside it")
        return kept

    def policy_digest(self, cell: Cell, seed: int) -> str | None:
        """The digest of the policy that a cell tries; None while it is not trained."""
        if cell.policy is not None:
            return agreement.shipped_digest(cell.policy)
        return None if (run := self.run(cell, seed)) is None else run["policy_digest"]

    def weights(self, cell: Cell, seed: int) -> Path | None:
        """A finished training's policy with its manifest beside it; None if it was too large and is not on this machine."""
        stem = self._run_stem(cell, seed)
        kept = self._runs(cell) / f"{stem}.safetensors"
        if kept.exists():
            return kept
        there = self.training_folder(cell, seed) / f"{stem}.safetensors"
        return there if there.exists() else None

    def training_folder(self, cell: Cell, seed: int) -> Path:
        """Where the run trains, with its checkpoint."""
        return self.work / (cell.runs_of or self.experiment.name) / self._run_stem(cell, seed)

    def start_folder(self, start: Start) -> Path:
        """Where a start trains, of whichever experiment; another recipe has another folder."""
        return self.work / "starts" / start_name(start)

    @property
    def work_folder(self) -> Path:
        """Of what is not committed of this experiment."""
        return self.work / self.experiment.name

    @property
    def farm_folder(self) -> Path:
        """Of its farm, which is large and forgotten with it."""
        return self.work_folder / "farm"

    def _runs(self, cell: Cell) -> Path:
        return self.out / (cell.runs_of or self.experiment.name) / "runs"

    @staticmethod
    def _run_stem(cell: Cell, seed: int) -> str:
        return Key(cell.runs_of_cell or cell.name, seed).stem

    def keep_run(
        self, cell: Cell, seed: int, record: Mapping[str, Any], digest: str, origin: Mapping[str, Any] | None = None
    ) -> None:
        """Keep what a training's record says, and its policy if it is small; the JSON last, since it says that all is there.

        ``origin`` has ``made_by``, the versions that trained it one after the other, and ``begun_with``, the digest of what it
        went on from or None.
        """
        folder, stem = self._runs(cell), self._run_stem(cell, seed)
        folder.mkdir(parents=True, exist_ok=True)
        trained = self.training_folder(cell, seed) / record["policy"]
        size = trained.stat().st_size
        if size <= LARGEST_WEIGHTS:
            shutil.copyfile(trained, folder / f"{stem}.safetensors")
            shutil.copyfile(trained.with_suffix(".json"), folder / f"{stem}.manifest.json")
        kept = {
            "settings": without_paths(record["settings"]),
            "samples": record["samples"],
            "wall_s": record["wall_s"],
            "starts": record.get("starts", 1),
            "curve": thinned(record["curve"], CURVE_POINTS),
            "evaluations": record["evaluations"],
            "final": record["final"],
            "policy_digest": digest,
            "weights": {"bytes": size, "here": size <= LARGEST_WEIGHTS},
        } | ({} if cell.training is None else agreement.made_with(cell.training))
        kept |= origin or {}
        self.files.write(folder / f"{stem}.json", "run", kept)

    def begun_with(self) -> dict[str, str]:
        """By the name of a start the digest of the training that runs of the experiment went on from, as far as they say it.

        Raises:
            StoreError: two of them went on from two trainings of one start.
        """
        found: dict[str, tuple[str, str]] = {}
        for cell in self.experiment.cells:
            start = None if (training := agreement.training_of(cell)) is None else training.start
            for seed in cell.seeds if start is not None else ():
                kept = self.run(cell, seed)
                if start is None or kept is None or (digest := kept.get("begun_with")) is None:
                    continue
                name, run = start.of(seed).name, self._run_stem(cell, seed)
                before, its = found.setdefault(name, (digest, run))
                if before != digest:
                    raise StoreError(
                        f"{its} went on from a training of {name} with the digest {before}, {run} from one with {digest}: runs "
                        f"that began with other weights do not compare; move one of them away from {self._runs(cell)}, with its "
                        "trials, to have it made anew"
                    )
        return {name: digest for name, (digest, _) in found.items()}

    def trained_by(self) -> list[list[Mapping[str, str]]]:
        """Of each finished training of the experiment's own the versions that made it in turn; none where they are unknown."""
        own = [(cell, seed) for cell in self.experiment.cells if cell.training is not None for seed in cell.seeds]
        return [kept.get("made_by", []) for cell, seed in own if (kept := self.run(cell, seed)) is not None]

    def trials(self, key: Key) -> dict[str, Any] | None:
        """What there is of a run's farm trials: ``blocks`` by their number, each a list of rows.

        Raises:
            StoreError: they are of another policy, or were asked for otherwise.
        """
        return self._of_design(self._trials(key), key, agreement.of_trials)

    def keep_block(
        self,
        key: Key,
        block: int,
        rows: Sequence[Mapping[str, Any]],
        about: Mapping[str, Any],
        made_by: Mapping[str, str] | None = None,
    ) -> None:
        """Add a block of trials, with the version that made it (:func:`experiments.provenance.made_by`) if that is known.

        Raises:
            StoreError: the other blocks are of another policy, were asked for otherwise, or are of another version, as those of
                other cells may be.
        """
        self.versions.of(TRIALS, made_by)
        path, cell = self._trials(key), self.experiment.cell(key.cell)
        found = self.trials(key) or {"blocks": {}}
        mixed = [
            f"{name} was {found[name]!r} and is {value!r}" for name, value in about.items() if found.get(name, value) != value
        ]
        self._refuse(path, mixed, "it")
        whole = dict(about) | {"blocks": found["blocks"] | {str(block): list(rows)}}
        if versions := found.get("made_by", {}) | ({} if made_by is None else {str(block): dict(made_by)}):
            whole["made_by"] = versions
        policy = self.policy_digest(cell, key.seed)
        self._refuse(path, agreement.of_trials(whole, self.experiment, cell, key.physics, policy), "it and the weights")
        self.files.write(path, "trials", whole)

    def _trials(self, key: Key) -> Path:
        return self.folder / TRIALS / f"{key.stem}.json"

    def measured(self, key: Key) -> dict[str, Any] | None:
        """What was measured in simulation.

        Raises:
            StoreError: it is of another policy, or was asked for otherwise.
        """
        return self._of_design(self._measured(key), key, agreement.of_measured)

    def keep_measured(self, key: Key, document: Mapping[str, Any]) -> None:
        """Keep what was measured in simulation; ``made_by`` in it is the version that made it.

        Raises:
            StoreError: other measurements are of another version.
        """
        self.versions.of(MEASURED, document.get("made_by"))
        self.files.write(self._measured(key), "measured", document)

    def _measured(self, key: Key) -> Path:
        return self.folder / MEASURED / f"{key.stem}.json"

    def write_document(self, text: str) -> Path:
        """Write the JSON of all findings beside the results."""
        return _written(self.out / f"{self.experiment.name}.json", text)

    def write_page(self, text: str) -> Path:
        """Write the page of the experiment."""
        return _written(self.page_folder / f"{self.experiment.name}.md", text)

    @property
    def page_folder(self) -> Path:
        """Of page and figure."""
        return self.pages or self.out

    def _of_design(self, path: Path, key: Key, differs: Callable[..., list[str]]) -> dict[str, Any] | None:
        if (kept := self.files.read(path)) is not None:
            cell = self.experiment.cell(key.cell)
            found = differs(kept, self.experiment, cell, key.physics, self.policy_digest(cell, key.seed))
            self._refuse(path, found, "it")
        return kept

    def _refuse(self, path: Path, differs: Sequence[str], what: str) -> None:
        if differs:
            what_to_do = f"move {what} away to have it made anew, or give another --out"
            raise StoreError(f"{path} was made by another design: {'; '.join(differs)}; {what_to_do}")


def thinned(points: Sequence[Any], most: int) -> list[Any]:
    """At most so many of the points, evenly, with the first and the last."""
    if len(points) <= most:
        return list(points)
    return [points[round(i * (len(points) - 1) / (most - 1))] for i in range(most)]


def without_paths(value: Any) -> Any:
    """The same with files named by their last part: where they lay on a machine is nobody's business."""
    if isinstance(value, Mapping):
        return {name: without_paths(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [without_paths(part) for part in value]
    return Path(value).name if isinstance(value, str) and value.startswith("/") else value


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path
