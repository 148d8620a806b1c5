"""Results on disk, each written at once when it is there and small enough to be committed. Owner of their names.

OUT/NAME/runs/CELL-seed1.json          a finished training: settings, thinned curve, evaluations, digest of the policy
OUT/NAME/runs/CELL-seed1.safetensors   its policy, where it is small, with the manifest as CELL-seed1.manifest.json
OUT/NAME/trials/CELL-seed1-real.json   farm trials, block by block
OUT/NAME/measured/CELL-seed1-real.json what was measured in simulation

Blocks and measurements say what made them. What was made by another design than the present one, or by two versions, is refused
where it is read.
"""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments import agreement
from experiments.design import Cell, Experiment, Start
from experiments.provenance import Versions, differing
from experiments.recipe_files import start_name
from trial_logs.disk import put_in_place

LARGEST_WEIGHTS = 300_000
"""Bytes; larger policies stay in the work folder."""
CURVE_POINTS = 60
TRIALS, MEASURED = "trials", "measured"
"""Folders of results that were not trained."""


class StoreError(Exception):
    """What lies there is none of this experiment; the message says what to do."""


@dataclass(frozen=True)
class Key:
    """One run of one cell on one kind of robots; ``physics`` is empty for a training."""

    cell: str
    seed: int
    physics: str = ""

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"{self.cell}-seed{self.seed}" + (f"-{self.physics}" if self.physics else "")


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

    def run(self, cell: Cell, seed: int) -> dict[str, Any] | None:
        """A finished training, wherever its experiment keeps it.

        Raises:
            StoreError: it is of another recipe.
        """
        path = self._runs(cell) / f"{self._run_stem(cell, seed)}.json"
        if (kept := self._read(path)) is not None:
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

    def keep_run(self, cell: Cell, seed: int, record: Mapping[str, Any], digest: str) -> None:
        """Keep what a training's record says, and its policy if it is small; the JSON last, since it says that all is there."""
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
        self._write(folder / f"{stem}.json", "run", kept)

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
        self.versions(TRIALS, made_by)
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
        self._write(path, "trials", whole)

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
        self.versions(MEASURED, document.get("made_by"))
        self._write(self._measured(key), "measured", document)

    def _measured(self, key: Key) -> Path:
        return self.folder / MEASURED / f"{key.stem}.json"

    def versions(self, kind: str, now: Mapping[str, str] | None = None) -> Versions:
        """What made all trials or all measurements (:data:`TRIALS`, :data:`MEASURED`) of the experiment, which compares them.

        Results that do not say what made them, as those of before versions were kept, go with any.

        Args:
            kind: of results.
            now: what would make more of them.

        Raises:
            StoreError: they are of two versions, or ``now`` is another; the message says what to do.
        """
        known, parts, unknown = dict(now or {}), 0, 0
        for path, versions in self._made_by(kind):
            for each in versions:
                parts += 1
                unknown += each is None
                if differs := differing(each or {}, known):
                    raise StoreError(
                        f"{path} was made by another version: {'; '.join(differs)}; results of two versions do not mix: move "
                        f"{path.parent} away to have all of them made anew, or give another --out"
                    )
                known |= each or {}
        return Versions(known, parts, unknown)

    def _made_by(self, kind: str) -> Iterator[tuple[Path, list[Mapping[str, str] | None]]]:
        """Of each file of a kind that belongs to the experiment what made its parts, None where it does not say."""
        stems = {Key(cell.name, seed).stem for cell in self.experiment.cells for seed in cell.seeds}
        for path in sorted((self.folder / kind).glob("*.json")):
            kept = self._read(path) if path.stem.rpartition("-")[0] in stems else None
            if kept is not None:
                made_by = kept.get("made_by")
                yield path, [(made_by or {}).get(block) for block in kept["blocks"]] if kind == TRIALS else [made_by]

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
        if (kept := self._read(path)) is not None:
            cell = self.experiment.cell(key.cell)
            found = differs(kept, self.experiment, cell, key.physics, self.policy_digest(cell, key.seed))
            self._refuse(path, found, "it")
        return kept

    def _write(self, path: Path, kind: str, document: Mapping[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        whole = {"format": f"trifarm-experiment-{kind}/1", "quick": self.experiment.quick} | dict(document)
        fresh = path.with_suffix(".new")
        fresh.write_text(json.dumps(whole, indent=1) + "\n")
        put_in_place(fresh, path)

    def _refuse(self, path: Path, differs: Sequence[str], what: str) -> None:
        if differs:
            what_to_do = f"move {what} away to have it made anew, or give another --out"
            raise StoreError(f"{path} was made by another design: {'; '.join(differs)}; {what_to_do}")

    def _read(self, path: Path) -> dict[str, Any] | None:
        if not path.exists():
            return None
        found = json.loads(path.read_text())
        if found["quick"] != self.experiment.quick:
            kind = "a quick form" if found["quick"] else "the full form"
            raise StoreError(f"{path} is a result of {kind}; quick and full results do not mix: give another --out")
        return found


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
