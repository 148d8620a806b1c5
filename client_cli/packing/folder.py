"""A folder of checkpoints packed in one go: one process, one line for each, and what one cannot be never stops the others."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from client_cli.packing.kinds import SUFFIXES, config_of
from client_cli.packing.packed_files import Packed, pack_to
from client_cli.packing.quiet import first_sentence
from client_cli.packing.reading import PICKLES, Statement, suffix_of
from client_cli.terminal.errors import ClientError, UsageProblem

PACKED = "packed"
"""The folder that is written where none is named."""
STATISTICS = re.compile(r"vec_?normalize", re.IGNORECASE)


@dataclass(frozen=True)
class Tried:
    """A checkpoint and what became of it: the policy, or why there is none."""

    file: Path
    packed: Packed | None
    why_not: str | None


def is_many(folder: Path) -> bool:
    """Whether a folder holds checkpoints, rather than being one (Hugging Face)."""
    return folder.is_dir() and not ((folder / "config.json").is_file() and bool(config_of(folder)))


def pack_folder(
    folder: Path, out: Path | None, stated: Statement, tell: Callable[[Tried], None], *, tolerance: float | None = None
) -> list[Tried]:
    """Pack every checkpoint of a folder into another, each under its own name; no two are written over each other.

    Args:
        folder: where they are; folders within it are left alone.
        out: where the policies are written; a folder ``packed`` within it if None.
        stated: what the files do not say, the same for all.
        tell: called with each as it is done.
        tolerance: as for :func:`packed_files.pack_to`.

    Raises:
        UsageProblem: there is nothing to pack, or it would be written over.
    """
    if out is not None and out.resolve() == folder.resolve():
        raise UsageProblem(f"--out {out} is the folder of the checkpoints, which would be written over; give another")
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix in SUFFIXES)
    if not files:
        raise UsageProblem(f"{folder} holds no checkpoint: no file in it ends in {', '.join(SUFFIXES)}")
    pickles = [path for path in sorted(folder.iterdir()) if path.suffix in PICKLES and STATISTICS.search(path.name)]
    tried = []
    for file, name in names_of(files).items():
        tried.append(_tried(file, pickles, (out or folder / PACKED) / name, stated, tolerance))
        tell(tried[-1])
    return tried


def names_of(files: Sequence[Path]) -> dict[Path, str]:
    """What each file's policy is called: its stem, or stem and ending where two files share the stem."""
    stems = Counter(file.stem for file in files)
    return {file: file.stem if stems[file.stem] == 1 else _told_apart(file, stems) for file in files}


def _told_apart(file: Path, taken: Collection[str]) -> str:
    name = f"{file.stem}-{file.suffix[1:]}"
    while name in taken:
        name += "-"
    return name


def _tried(file: Path, pickles: Sequence[Path], out: Path, stated: Statement, tolerance: float | None) -> Tried:
    try:
        given = [file, *_statistics_of(file, pickles)]
        target = out.with_name(f"{out.name}{suffix_of(file, stated)}")
        return Tried(file, pack_to(target, given, stated, tolerance=tolerance), None)
    except ClientError as error:
        return Tried(file, None, error.detail)
    except Exception as error:  # whatever a stranger's program does: the others are packed all the same
        return Tried(file, None, first_sentence(error))


def _statistics_of(file: Path, pickles: Sequence[Path]) -> list[Path]:
    """The VecNormalize of an archive: of its own steps, as CheckpointCallback names it, or the only one there is.

    Raises:
        UsageProblem: there are several, and none is this one's.
    """
    if file.suffix != ".zip" or not pickles:
        return []
    own = [path for path in pickles if STATISTICS.sub("", path.stem).replace("__", "_").strip("_") == file.stem]
    if own or len(pickles) == 1:
        return [(own or list(pickles))[0]]
    raise UsageProblem(
        f"the folder has {len(pickles)} files of VecNormalize and none is named like {file.name}: pack it by itself with its own"
    )
