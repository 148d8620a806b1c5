"""Trainings as child processes, several side by side; each keeps its result as soon as it is finished, and none outlives us."""

import hashlib
import json
import os
import signal
import subprocess
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from api_schemas.policy import PolicyManifest
from client_cli.embedded.child_process import child_environment, module_command
from client_cli.policies.policy_files import read_policy
from experiments.design import Demonstrations, Start
from experiments.plan import TrainingPiece, starts
from experiments.provenance import DIGITS, trained_by
from experiments.recipe_files import (
    changes_since,
    cut,
    demonstrations_folder,
    demonstrations_name,
    recording_arguments,
    start_document,
    toml_of,
    write_recipe,
)
from experiments.result_files import Key, StoreError
from experiments.store import Store
from sim_backend.folder_lock import taken
from sim_backend.training.folder import CHECKPOINT, RECORD

POLL_EVERY_S = 0.5
ENDS_WITHIN_S = 30.0
LAST_LINES = 12
OTHER_FOLDERS = "give another --work and --out"
ORIGIN = "origin.json"
"""What we leave there: the versions that made the run, and the digest of what it began with."""


class TrainingFailedError(Exception):
    """A training or a recording ended without a result; the message has its last lines."""


@dataclass(frozen=True)
class Running:
    """A training that runs."""

    piece: TrainingPiece
    folder: Path
    log: Path
    process: subprocess.Popen[bytes]


def train_all(
    pieces: Sequence[TrainingPiece],
    store: Store,
    *,
    jobs: int,
    goes_on: Callable[[], bool],
    tell: Callable[[str], None],
) -> bool:
    """Train what is missing; no run is begun once ``goes_on`` says no, and those that run are awaited.

    Returns:
        Whether all were trained.

    Raises:
        TrainingFailedError: one ended otherwise than it should.
        StoreError: there is a checkpoint of another recipe.
    """
    for piece in pieces:
        _check_checkpoint(piece, store)
    _check_starts(pieces, store)
    waiting, running = list(pieces), []
    try:
        while running or (waiting and goes_on()):
            while waiting and len(running) < jobs and goes_on():
                running.append(_start(waiting.pop(0), store, tell))
            time.sleep(POLL_EVERY_S)
            for each in [one for one in running if one.process.poll() is not None]:
                running.remove(each)
                _keep(each, store, tell)
    finally:
        _end([each.process for each in running])  # there are some only after an error or a Ctrl-C
    return not waiting


def _end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Let all of them keep a checkpoint and end; what has not ended after some time is killed."""
    with _undisturbed():
        for each in processes:
            each.send_signal(signal.SIGINT)
        until_s = time.monotonic() + ENDS_WITHIN_S
        for each in processes:
            try:
                each.wait(max(0.0, until_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                each.kill()
                each.wait()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """No second Ctrl-C in between, which would leave children behind; it takes bounded time anyhow."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _check_checkpoint(piece: TrainingPiece, store: Store) -> None:
    training, folder = piece.cell.training, store.training_folder(piece.cell, piece.seed)
    assert training is not None
    if not (folder / CHECKPOINT).exists():
        return
    if differs := changes_since(folder, Key(piece.cell.name, piece.seed).stem, training, piece.seed):
        raise StoreError(
            f"{folder} has the checkpoint of another recipe: {'; '.join(differs)}; move the folder away to begin anew, or give "
            "another --work"
        )


def _check_starts(pieces: Sequence[TrainingPiece], store: Store) -> None:
    """Those that are there already, before hours of training."""
    for start in starts(pieces):
        if (store.start_folder(start) / RECORD).exists():
            _checked_start(start, store)


def _checked_start(start: Start, store: Store) -> str:
    """The digest of a start that is trained.

    Raises:
        StoreError: runs that are kept went on from another training of it.
    """
    folder = store.start_folder(start)
    digest, before = weights_digest(folder / CHECKPOINT), store.begun_with().get(start.name)
    if before not in (None, digest):
        raise StoreError(
            f"{folder} has another training of {start.name} (digest {digest}) than that which the runs in {store.folder} went on "
            f"from ({before}); bring that folder from the machine which trained it, or move those runs and their trials away to "
            "have all of them made anew"
        )
    return digest


def weights_digest(checkpoint: Path) -> str:
    """The digest of all tensors of a checkpoint, actor, critic and optimiser, in their order; not of the seconds that it took.

    It is read as the archive that torch writes, with a file of bytes for each tensor, so that torch is not loaded for it.
    """
    digest = hashlib.sha256()
    with zipfile.ZipFile(checkpoint) as archive:
        tensors = [name for name in archive.namelist() if name.split("/")[-2] == "data" and name.split("/")[-1].isdecimal()]
        for name in sorted(tensors, key=lambda each: int(each.split("/")[-1])):
            digest.update(archive.read(name))
    return digest.hexdigest()[:DIGITS]


def _noted(folder: Path, begun_with: str | None, resumes: bool) -> None:
    """Write beside a run that begins or goes on what makes it, and what it began with.

    Raises:
        StoreError: its checkpoint began with other weights.
    """
    path, now = folder / ORIGIN, trained_by()
    noted = json.loads(path.read_text()) if path.exists() and resumes else {"made_by": [{}] if resumes else []}
    if (before := noted.get("begun_with", begun_with)) != begun_with:
        raise StoreError(
            f"{folder} has a checkpoint that began with weights of the digest {before}, while its start has {begun_with} now; "
            "move the folder away to begin anew"
        )
    versions = noted["made_by"] if noted["made_by"][-1:] == [now] else [*noted["made_by"], now]
    path.write_text(json.dumps({"made_by": versions, "begun_with": begun_with}, indent=1) + "\n")


def _start(piece: TrainingPiece, store: Store, tell: Callable[[str], None]) -> Running:
    training = piece.cell.training
    assert training is not None
    folder, stem = store.training_folder(piece.cell, piece.seed), Key(piece.cell.name, piece.seed).stem
    folder.mkdir(parents=True, exist_ok=True)
    shown = None if training.demonstrations is None else _demonstrations(training.demonstrations, store, tell)
    start = begun_with = None
    if training.start is not None:
        begun = training.start.of(piece.seed)
        start, begun_with = _trained_start(begun, store, tell), _checked_start(begun, store)
    recipe = write_recipe(training, piece.seed, folder, stem, shown, start)
    resumes = (folder / CHECKPOINT).exists()
    _noted(folder, begun_with, resumes)
    tell(f"{piece.name}: {'goes on' if resumes else 'begins'}, {training.samples:,} samples, log in {folder / 'log'}")
    flags = ["--out", str(folder), "--threads", "1", *(["--resume"] if resumes else [])]
    return Running(piece, folder, folder / "log", _child("sim_backend.training", [str(recipe), *flags], folder / "log"))


def _child(module: str, arguments: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    with log.open("ab") as out:
        command = module_command(module, *arguments)
        environment, nothing = child_environment(**threads), subprocess.DEVNULL
        # what is inherited is the lock
        return subprocess.Popen(command, env=environment, stdin=nothing, stdout=out, stderr=out, close_fds=False)


def _await(what: str, module: str, arguments: Sequence[str], log: Path) -> None:
    process = _child(module, arguments, log)
    try:
        process.wait()
    finally:
        if process.poll() is None:
            _end([process])
    if process.returncode != 0:
        raise TrainingFailedError(f"{what} ended with code {process.returncode}:\n{_tail(log)}")


def _demonstrations(shown: Demonstrations, store: Store, tell: Callable[[str], None]) -> Path:
    """The demonstrations of a cell, recorded now if they are not there; the same on every machine."""
    folder = store.work_folder / "demonstrations" / demonstrations_folder(shown)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = folder / demonstrations_name(shown)
    if not wanted.exists():
        recorded = folder / f"{shown.policy}-for-{shown.count}.demonstrations"
        tell(f"recording {shown.count} demonstrations of {shown.policy}")
        arguments = recording_arguments(shown, recorded)
        _await("recording demonstrations", "sim_backend.training.demonstrations.recording", arguments, folder / "log")
        cut(recorded, shown.count, wanted)
    return wanted


def _trained_start(start: Start, store: Store, tell: Callable[[str], None]) -> Path:
    """The folder of a start, trained now if it is not there; another experiment that trains it is waited for."""
    folder = store.start_folder(start)
    if (folder / RECORD).exists():
        return folder
    with taken(folder, f"training {start.name}", OTHER_FOLDERS, waits=tell):
        if not (folder / RECORD).exists():
            path = folder / f"{start.name}.toml"
            path.write_text(toml_of(start_document(start)))
            tell(f"training {start.name}, which several runs go on from, log in {folder / 'log'}")
            resumes = ["--resume"] if (folder / CHECKPOINT).exists() else []
            flags = ["--out", str(folder), "--threads", str(start.threads), *resumes]
            _await(start.name, "sim_backend.training", [str(path), *flags], folder / "log")
    return folder


def _keep(done: Running, store: Store, tell: Callable[[str], None]) -> None:
    code = done.process.returncode
    if code != 0:
        raise TrainingFailedError(f"{done.piece.name} ended with code {code}; the end of {done.log}:\n{_tail(done.log)}")
    record = json.loads((done.folder / RECORD).read_text())
    digest = read_policy(done.folder / record["policy"], None, None).digest
    store.keep_run(done.piece.cell, done.piece.seed, record, digest, json.loads((done.folder / ORIGIN).read_text()))
    rates = ", ".join(f"{each['success_rate']:.0%} on {each['physics']} robots" for each in record["final"])
    tell(f"{done.piece.name}: finished after {record['wall_s'] / 60:.1f} min, {rates or 'not tried'}")


def _tail(log: Path) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-LAST_LINES:])


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def manifest_beside(weights: Path) -> Path:
    """The manifest of a kept policy, or that which the training program wrote."""
    kept = weights.with_name(weights.stem + ".manifest.json")
    return kept if kept.exists() else weights.with_suffix(".json")


def manifest_of(weights: Path) -> PolicyManifest:
    """What a policy expects."""
    return PolicyManifest.model_validate_json(manifest_beside(weights).read_text())
