"""Policies as files on this machine: packed from a training library's checkpoint, checked as the farm checks them."""

from collections.abc import Sequence
from pathlib import Path

from api_schemas.job import POLICY_TASKS, TaskName
from api_schemas.policy import LAYOUTS, PolicyCheck, PolicyManifest
from client_cli.packing.packed_files import Packed, pack_to
from client_cli.packing.reading import Statement
from client_cli.policies.checking import and_tried, checked_here, expected
from client_cli.policies.policy_files import LAYOUT_NAMES, check_is_file, read_manifest
from client_cli.policies.trying import task_of
from client_cli.terminal.errors import UsageProblem
from trifarm.wording import worded

__all__ = ["Packed", "check", "pack"]

_ARGUMENTS = {"format": "form", "manifest": "expects", "layout": "expects"}
"""Options of ``trifarm pack`` that are called otherwise here."""


def pack(
    files: Path | str | Sequence[Path | str],
    out: Path | str | None = None,
    *,
    expects: str | Path | PolicyManifest,
    form: str = "auto",
    architecture: str | None = None,
    activation: str | None = None,
    scale: float | None = None,
    states: Sequence[tuple[int, ...]] = (),
    normaliser: str | None = None,
    action_normaliser: str | None = None,
    tolerance: float | None = None,
    python: Path | str | None = None,
) -> Packed:
    """Packs a training library's checkpoint into weights and manifest, compared with the original on 1,000 observations.

    Reading a checkpoint runs the code in it: pack only files that you trust.

    Args:
        files: a checkpoint; of stable-baselines3 with its ``VecNormalize`` pickle beside it.
        out: ``NAME.safetensors``, or ``NAME.onnx`` for TorchScript and ``torch.export`` programs; beside the checkpoint if None.
            The manifest is ``NAME.json``.
        expects: the observation that it was trained on: a ready-made layout by its name, a manifest's file, or a manifest.
        form: kind of the file, where it does not show: ``sb3``, ``rl-games``, ``rsl-rl``, ``skrl``, ``state-dict`` …
        architecture: the actor's modules in order, such as ``lstm,actor.0,actor.2``.
        activation: ``elu``, ``relu`` or ``tanh``, where the file does not say.
        scale: what an action of 1 of the training is, N m or rad.
        states: shapes of the states of a TorchScript program.
        normaliser: of a plain state dict: ``MEAN,VARIANCE[,EPSILON[,CLIP]]`` by name, or ``none``.
        action_normaliser: numbers of a plain state dict that make actions of outputs: ``mean-std:MEAN,STD``, ``min-max:MIN,MAX``,
            ``scale-bias:SCALE,BIAS`` or ``tanh-scale-bias:SCALE,BIAS`` by name, or ``none``.
        tolerance: the largest difference of an action that passes; by the original's own rounding if None.
        python: the interpreter of an environment that has LeRobot, for its policies.

    Raises:
        ClientError: a file cannot be read or packed, or the packed policy acts otherwise than the original.

    Example:
        >>> import torch, trifarm  # rrc2022-push is an observation of 54 numbers
        >>> network = {"architecture": "0,2", "activation": "tanh", "normaliser": "none"}
        >>> actor = torch.nn.Sequential(torch.nn.Linear(54, 32), torch.nn.Tanh(), torch.nn.Linear(32, 9))
        >>> torch.save(actor.state_dict(), "actor.pt")
        >>> trifarm.pack("actor.pt", "mine.safetensors", expects="rrc2022-push", **network).unit
        'N m'
    """
    given = [Path(files)] if isinstance(files, str | Path) else [Path(each) for each in files]
    stated = Statement(
        _manifest(expects),
        form=form,
        architecture=architecture,
        activation=activation,
        scale=scale,
        states=tuple(states),
        normaliser=normaliser,
        action_normaliser=action_normaliser,
        python=None if python is None else Path(python),
    )
    with worded(_ARGUMENTS):
        return pack_to(None if out is None else Path(out), given, stated, tolerance=tolerance)


def check(
    weights: Path | str,
    *,
    expects: str | Path | PolicyManifest | None = None,
    task: TaskName | str | None = None,
    tries: bool = True,
) -> PolicyCheck:
    """Says whether a farm would accept a policy, by the farm's own checks run here, and tries it; nothing is sent.

    Args:
        weights: a .safetensors, .onnx or stable-baselines3 .zip file.
        expects: a ready-made layout by its name, a manifest's file, or a manifest; the file beside the weights if None.
        task: the task of the short trials; by the goal that the policy sees if None.
        tries: whether a policy that would be accepted is tried in 20 short trials in a small nominal simulation.

    Returns:
        The verdict; ``problem`` says what to do where the farm would refuse, ``warnings`` what was strange in checks and trials.

    Raises:
        ClientError: there is no such file, or the checks broke.

    Example:
        >>> import trifarm
        >>> trifarm.check("push.safetensors").accepted
        True
    """
    file = Path(weights)
    check_is_file(file)
    if task is not None and task not in POLICY_TASKS:
        raise UsageProblem(f"there is no task {str(task)!r} for a policy; choose from {', '.join(POLICY_TASKS)}")
    with worded(_ARGUMENTS):
        manifest = expected(file, None, None) if expects is None else _manifest(expects)
        said = checked_here(file, manifest)
        chosen = task or task_of(manifest)
        return and_tried(said, file, manifest, chosen) if said.accepted and tries and chosen is not None else said


def _manifest(expects: str | Path | PolicyManifest) -> PolicyManifest:
    if isinstance(expects, PolicyManifest):
        return expects
    if isinstance(expects, str) and expects in LAYOUTS:
        return LAYOUTS[expects]
    if not Path(expects).is_file():
        raise UsageProblem(f"{str(expects)!r} is neither a manifest's file nor a layout; layouts are {LAYOUT_NAMES}")
    return read_manifest(Path(expects))
