"""Tensors of a program that its actions do not depend on: found by changing each, because nobody can read how it uses them."""

from collections.abc import Mapping
from typing import Any

from api_schemas.policy import PolicyManifest
from client_cli.packing import action_normaliser, checkpoints
from client_cli.packing.quiet import quiet
from client_cli.packing.recipe import Array
from client_cli.packing.whole import Program
from client_cli.terminal.errors import UsageProblem

ROWS, SEED = 4, 11
"""Observations that each change is tried on, a trial of two steps each."""


def tensors_of(program: Program) -> dict[str, Any]:
    """Parameters and buffers of a program by name; none where it keeps its numbers as constants."""
    return dict(program.module.state_dict()) if hasattr(program.module, "state_dict") else {}


def arrays_of(program: Program) -> dict[str, Array]:
    """The same as arrays."""
    return {name: each.detach().cpu().float().numpy() for name, each in tensors_of(program).items()}


def unused(program: Program, takes: int) -> tuple[str, ...]:
    """Names of the tensors that make no difference to what the program gives, whatever stands in them.

    Args:
        program: it has run on observations of ``takes`` numbers.
        takes: numbers that it takes.
    """
    import torch

    named = tensors_of(program)
    kept = {name: each.clone() for name, each in named.items()}
    rows = 2.0 * torch.randn(ROWS, 1, takes, generator=torch.Generator().manual_seed(SEED))

    def given_with(name: str | None, change: Any = None) -> Any:
        with torch.no_grad():
            for each, values in named.items():
                values.copy_(kept[each] if each != name else change(kept[each]))
        return _given(program, rows)

    try:
        before = given_with(None)
        return tuple(name for name in named if all(_alike(before, given_with(name, change)) for change in (_broken, _other)))
    finally:
        given_with(None)


def _given(program: Program, rows: Any) -> list[Any] | None:
    """All that comes out, None where it cannot be run."""
    outputs = []
    try:
        with quiet():
            for row in rows:
                memory = program.blank()
                for _ in range(2):
                    action, *memory = program.run(row, memory)
                    outputs += [action.clone(), *(each.clone() for each in memory)]
    except Exception:
        return None
    return outputs


def _broken(values: Any) -> Any:
    return values.new_full(values.shape, float("nan")) if values.is_floating_point() else _other(values)


def _other(values: Any) -> Any:
    return values.logical_not() if str(values.dtype) == "torch.bool" else 2 * values + 1


def _alike(before: Any, after: Any) -> bool:
    import torch

    if before is None or after is None:
        return False
    return all(torch.equal(a.nan_to_num(7.0), b.nan_to_num(7.0)) for a, b in zip(before, after, strict=True))


def check_normalisers(
    names: tuple[str, ...], tensors: Mapping[str, Array], manifest: PolicyManifest, *, says_actions: bool, says_observations: bool
) -> None:
    """Raises where a program holds what looks like a normaliser and does without it, and nobody has said that it may.

    Args:
        names: tensors that it does without.
        tensors: all of them.
        manifest: of the observation that it takes.
        says_actions: the user has said that outputs are actions as they are.
        says_observations: the user has said that it takes observations as they are.

    Raises:
        UsageProblem: names them, and says what to do.
    """
    actions = [] if says_actions else action_normaliser.look_alikes(names, tensors)
    sizes = {manifest.observation_size, manifest.network_inputs}
    means, spreads = checkpoints.statistics_alike({name: tensors[name] for name in names}, sizes)
    seen = [] if says_observations or not (means and spreads) else [means[0], spreads[0]]
    for alike, of, option in ((actions, "actions", "--action-normaliser"), (seen, "observations", "--normaliser")):
        if alike:
            raise UsageProblem(
                f"{', '.join(alike[:4])} look like a normaliser of the {of}, and the program does without them: apply them "
                f"in its forward and export it again, write them into the manifest, or give {option} none if {of} are as they are"
            )
