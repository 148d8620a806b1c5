"""Which versions made an experiment's trials and measurements, and where those lie that count no more. Owner of ``set-aside``."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from experiments.provenance import Versions, differing
from experiments.result_files import MEASURED, RUNS, TRIALS, Key, ResultFiles, StoreError

SET_ASIDE = "set-aside"


@dataclass(frozen=True)
class KeptVersions:
    """Of the trials and measurements in the files of an experiment."""

    files: ResultFiles

    def of(self, kind: str, now: Mapping[str, str] | None = None) -> Versions:
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
            for each in versions.values():
                parts += 1
                unknown += each is None
                if differs := differing(each or {}, known):
                    raise StoreError(
                        f"{path} was made by another version: {'; '.join(differs)}; results of two versions do not mix: move "
                        f"{path.parent} away to have all of them made anew, or give another --out"
                    )
                known |= each or {}
        return Versions(known, parts, unknown)

    def outdated(self, kind: str, now: Callable[[str], Mapping[str, str]]) -> dict[tuple[str, str], list[str]]:
        """What is of another version than would make it now: what differs, by the stem of its file and its block.

        Args:
            kind: trials or measurements; of these the block is empty.
            now: what would make them on robots of a physics.
        """
        found = {}
        for path, versions in self._made_by(kind):
            for part, each in versions.items():
                if each is not None and (differs := differing(each, now(path.stem.rpartition("-")[2]))):
                    found[path.stem, part] = differs
        return found

    def set_aside(self, kind: str, now: Callable[[str], Mapping[str, str]]) -> Path | None:
        """Move what is of another version than now's out of what counts; the folder where it lies then, None if there is none."""
        outdated = self.outdated(kind, now)
        if not outdated:
            return None
        paths = [self.files.folder / kind / f"{stem}.json" for stem in sorted({stem for stem, _ in outdated})]
        aside = self._new_folder_aside(kind)
        for path in paths:
            kept = self.files.read(path)
            assert kept is not None
            gone = {part for stem, part in outdated if stem == path.stem}
            self.files.write(aside / path.name, kind, _parts(kept, gone) if kind == TRIALS else kept)
            if kind == TRIALS and (left := kept["blocks"].keys() - gone):
                self.files.write(path, kind, _parts(kept, left))
            else:
                path.unlink()
        return aside

    def _new_folder_aside(self, kind: str) -> Path:
        numbers = (number for number in count(1) if not (self.files.folder / SET_ASIDE / f"version-{number}" / kind).exists())
        return self.files.folder / SET_ASIDE / f"version-{next(numbers)}" / kind

    def aside(self) -> dict[str, int]:
        """How many trainings, blocks of trials and measurements do not count any more, by their kind."""
        found = {kind: sorted((self.files.folder / SET_ASIDE).glob(f"*/{kind}/*.json")) for kind in (RUNS, TRIALS, MEASURED)}
        found[RUNS] = [path for path in found[RUNS] if not path.name.endswith(".manifest.json")]
        blocks = sum(len(json.loads(path.read_text())["blocks"]) for path in found[TRIALS])
        return {RUNS: len(found[RUNS]), TRIALS: blocks, MEASURED: len(found[MEASURED])}

    def _made_by(self, kind: str) -> Iterator[tuple[Path, dict[str, Mapping[str, str] | None]]]:
        """Of each file of a kind that belongs to the experiment what made its blocks, None where it does not say."""
        stems = {Key(cell.name, seed).stem for cell in self.files.experiment.cells for seed in cell.seeds}
        for path in sorted((self.files.folder / kind).glob("*.json")):
            kept = self.files.read(path) if path.stem.rpartition("-")[0] in stems else None
            if kept is not None:
                made_by = kept.get("made_by")
                of_blocks = {block: (made_by or {}).get(block) for block in kept.get("blocks", ())}
                yield path, of_blocks if kind == TRIALS else {"": made_by}


def _parts(kept: Mapping[str, Any], blocks: Collection[str]) -> dict[str, Any]:
    """Trials with some of their blocks alone."""
    of_blocks = {name: kept[name] for name in ("blocks", "made_by") if name in kept}
    return dict(kept) | {name: {key: part[key] for key in part if key in blocks} for name, part in of_blocks.items()}
