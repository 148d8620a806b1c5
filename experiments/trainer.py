"""Trainings as child processes, several side by side; each keeps its result as soon as it is finished."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from api_schemas.policy import PolicyManifest
from client_cli.child_process import child_environment, module_command
from client_cli.policy_files import read_policy
from experiments.design import Demonstrations, Start
from experiments.plan import TrainingPiece
from experiments.recipe_files import cut, recording_arguments, toml_of, write_recipe
from experiments.store import Key, Store

POLL_EVERY_S = 0.5
ENDS_WITHIN_S = 30.0
LAST_LINES = 12
CHECKPOINT, RECORD = "checkpoint.pt", "record.json"
"""What the training program leaves in its folder (sim_backend/training/evaluating.py, which needs torch)."""


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
    """
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
        for each in running:  # reached only by an error or a Ctrl-C: they keep a checkpoint and end
            each.process.send_signal(signal.SIGINT)
        for each in running:
            _await_end(each.process)
    return not waiting


def _await_end(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _start(piece: TrainingPiece, store: Store, tell: Callable[[str], None]) -> Running:
    training = piece.cell.training
    assert training is not None
    folder, stem = store.training_folder(piece.cell, piece.seed), Key(piece.cell.name, piece.seed).stem
    folder.mkdir(parents=True, exist_ok=True)
    shown = None if training.demonstrations is None else _demonstrations(training.demonstrations, store, tell)
    start = None if training.start is None else _trained_start(training.start, store, tell)
    recipe = write_recipe(training, piece.seed, folder, stem, shown, start)
    resumes = (folder / CHECKPOINT).exists()
    tell(f"{piece.name}: {'goes on' if resumes else 'begins'}, {training.samples:,} samples, log in {folder / 'log'}")
    flags = ["--out", str(folder), "--threads", "1", *(["--resume"] if resumes else [])]
    return Running(piece, folder, folder / "log", _child("sim_backend.training", [str(recipe), *flags], folder / "log"))


def _child(module: str, arguments: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    with log.open("ab") as out:
        command = module_command(module, *arguments)
        return subprocess.Popen(command, env=child_environment(**threads), stdin=subprocess.DEVNULL, stdout=out, stderr=out)


def _await(what: str, module: str, arguments: Sequence[str], log: Path) -> None:
    process = _child(module, arguments, log)
    if process.wait() != 0:
        raise TrainingFailedError(f"{what} ended with code {process.returncode}:\n{_tail(log)}")


def _demonstrations(shown: Demonstrations, store: Store, tell: Callable[[str], None]) -> Path:
    """The demonstrations of a cell, recorded now if they are not there; the same on every machine."""
    folder = store.work / store.experiment.name / "demonstrations"
    folder.mkdir(parents=True, exist_ok=True)
    wanted = folder / f"{shown.policy}-{shown.count}.demonstrations"
    if not wanted.exists():
        recorded = folder / f"{shown.policy}-for-{shown.count}.demonstrations"
        tell(f"recording {shown.count} demonstrations of {shown.policy}")
        arguments = recording_arguments(shown, recorded)
        _await("recording demonstrations", "sim_backend.training.demonstrations.recording", arguments, folder / "log")
        cut(recorded, shown.count, wanted)
    return wanted


def _trained_start(start: Start, store: Store, tell: Callable[[str], None]) -> Path:
    """The folder of a start, trained now, on all cores, if it is not there."""
    recipe = toml_of({**start.recipe, "seed": 1})
    folder = store.start_folder(start, recipe)
    if not (folder / RECORD).exists():
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{start.name}.toml"
        path.write_text(recipe)
        tell(f"training {start.name}, which several runs go on from, log in {folder / 'log'}")
        resumes = ["--resume"] if (folder / CHECKPOINT).exists() else []
        flags = ["--out", str(folder), "--threads", str(cores()), *resumes]
        _await(start.name, "sim_backend.training", [str(path), *flags], folder / "log")
    return folder


def _keep(done: Running, store: Store, tell: Callable[[str], None]) -> None:
    code = done.process.returncode
    if code != 0:
        raise TrainingFailedError(f"{done.piece.name} ended with code {code}; the end of {done.log}:\n{_tail(done.log)}")
    record = json.loads((done.folder / RECORD).read_text())
    digest = read_policy(done.folder / record["policy"], None, None).digest
    store.keep_run(done.piece.cell, done.piece.seed, record, digest)
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
