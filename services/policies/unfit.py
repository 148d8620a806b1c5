"""The one error of weights that are not taken: why, which part of the file, and what to do instead."""

import shlex

from api_schemas.observation import OBSERVATION_SIZES, sizes_of
from api_schemas.policy import ACTION_SIZE, LAYOUTS, PolicyManifest
from api_schemas.policy_network import ActionHead
from services.errors import Refused

NAME_LIMIT = 100
MOST_ROWS = 11
"""Of a comparison of two layouts: more fill a screen and say less."""


class UnfitError(Exception):
    """The weights and the manifest do not make a policy; the message says why.

    Args:
        why: a sentence without its full stop.
        part: the entry, tensor or operator it is about; empty where it is the whole file.
        instead: what to do; empty where ``why`` says it.
        slug: the problem's type.
        pack: whether reading the file runs its author's code, so that only the author's own machine may do it.
    """

    def __init__(
        self, why: str, *, part: str = "", instead: str = "", slug: str = "conversion-failed", pack: bool = False
    ) -> None:
        super().__init__(why)
        self.why = why
        self.part = part
        self.instead = instead
        self.slug = slug
        self.pack = pack


def not_finite(part: str) -> UnfitError:
    """The error for a tensor with NaN or infinity in it."""
    return UnfitError(
        "it holds numbers that are not finite",
        part=part,
        slug="weights-not-finite",
        instead="look for the step of the training at which it diverged, and send weights from before",
    )


def too_slow(why: str) -> UnfitError:
    """The error for a network that cannot keep its rate."""
    return UnfitError(
        why,
        part="the dry run",
        instead="send a smaller network, or state a lower rate_hz if it was trained with one",
        slug="dry-run-too-slow",
    )


def blind_format(kind: str) -> UnfitError:
    """The error for weights of a form that cannot see whose manifest asks for images."""
    return UnfitError(
        f"the manifest asks for images, and weights of the form {kind} are of a network that takes an observation alone",
        part="the manifest's images",
        instead="export the network as ONNX with an input for images, or leave images out of the manifest",
        slug="images-need-onnx",
    )


def graph_too_large(size: int, limit_bytes: int) -> UnfitError:
    """The error for weights that are small as they were sent and large as robots run them."""
    return UnfitError(
        f"unpacked, as robots run it, the policy has {size} bytes; at most {limit_bytes} are taken",
        instead="send a smaller network",
        slug="graph-too-large",
    )


def problem_of(error: UnfitError, filename: str | None) -> dict[str, str]:
    """The error as the members of a problem document: slug, detail, file, part and instead."""
    file = printable(filename)
    instead = error.instead
    if error.pack:
        instead = f"run `trifarm pack {shlex.quote(file)}` on your own machine and upload what it writes"
    part = _plain(error.part)
    where = f"{file}, {part}" if part else file
    detail = f"{where}: {_plain(error.why)}" + (f"; {instead}" if instead else "")
    return {"slug": error.slug, "detail": f"{detail}.", "file": file, "part": part, "instead": instead}


def _plain(text: str) -> str:
    """Without what would steer a terminal: names within a file are a stranger's, and parsers quote them."""
    return "".join(each if each.isprintable() or each == "\n" else "?" for each in text)


def refused(error: UnfitError, filename: str | None) -> Refused:
    """The error as the services' own, about a file of that name."""
    return Refused(**problem_of(error, filename))


def printable(name: str | None) -> str:
    """A name that a user gave, short and without control characters."""
    text = "".join(each if each.isprintable() else "?" for each in name or "")
    return (text if len(text) <= NAME_LIMIT else text[:NAME_LIMIT] + "…") or "FILE"


def wrong_input(manifest: PolicyManifest, network_inputs: int) -> UnfitError:
    """The error for a network whose input does not have the manifest's size: both lists side by side."""
    size = manifest.observation_size
    layouts = {name: each for name, each in LAYOUTS.items() if (each.images is None) == (manifest.images is None)}
    nearest = min(layouts, key=lambda name: abs(layouts[name].observation_size - network_inputs))
    near = layouts[nearest]
    fitting = [name for name, layout in layouts.items() if layout.observation_size == network_inputs]
    fits = manifest.frame_stack is None and bool(fitting)
    instead = f"the layout {' or '.join(fitting)} fits" if fits else "name the fields that it was trained on"
    return UnfitError(
        f"the manifest's observation has {size} numbers ({_fields(manifest)}){_stacked(manifest)}, "
        f"but the network takes {network_inputs}; "
        f"the nearest ready-made layout is {nearest} with {near.observation_size}\n"
        f"{side_by_side(manifest, nearest, network_inputs)}\n",
        part="the network's input",
        instead=f"{instead}; every field and its size: {_all_fields()}",
        slug="observation-does-not-fit",
    )


def side_by_side(manifest: PolicyManifest, layout: str, network_inputs: int) -> str:
    """The manifest's fields beside those of a ready-made layout, each with the elements it takes, and the network's count."""
    left = ["the manifest", *_rows(manifest)]
    right = [f"layout {layout}", *_rows(LAYOUTS[layout])]
    height = max(len(left), len(right))
    pad = max(len(row) for row in left)
    rows = list(zip(left + [""] * (height - len(left)), right + [""] * (height - len(right)), strict=True))
    shown = [f"  {one:<{pad}} | {other}".rstrip() for one, other in rows]
    if len(shown) > MOST_ROWS:
        first = next((index for index, (one, other) in enumerate(rows[1:], 1) if one != other), 1)
        begin = max(1, min(first - 1, len(shown) - MOST_ROWS))
        cut = [f"  … {len(shown) - MOST_ROWS} more rows: 'trifarm layouts {layout}'"]
        shown = [shown[0], *shown[begin : begin + MOST_ROWS - 2], *cut]
    return "\n".join(shown) + f"\n  the network takes {network_inputs}"


def _rows(manifest: PolicyManifest) -> list[str]:
    """One row for each field, such as "0-8 joint_position_rad 9", and the sum."""
    rows, at = [], 0
    for name, size in zip(manifest.observation, sizes_of(manifest.observation), strict=True):
        rows.append(f"{at}-{at + size - 1} {name} {size}" if size > 1 else f"{at} {name} {size}")
        at += size
    return [*rows, f"sum {at}"]


def _fields(manifest: PolicyManifest) -> str:
    return ", ".join(f"{name} {size}" for name, size in zip(manifest.observation, sizes_of(manifest.observation), strict=True))


def _all_fields() -> str:
    return ", ".join(f"{name} {size}" for name, size in OBSERVATION_SIZES.items())


def _stacked(manifest: PolicyManifest) -> str:
    stack = manifest.frame_stack
    return "" if stack is None else f", stacked {stack.count} times {manifest.network_inputs}"


def wrong_output(network_outputs: object, manifest: PolicyManifest) -> UnfitError:
    """The error for a network that does not give the numbers that an action is made of."""
    direct = manifest.head is ActionHead.DIRECT
    wanted = f"an action has {ACTION_SIZE}: one for each joint" if direct else f"the head {manifest.head.value!r} needs"
    return UnfitError(
        f"the network gives {network_outputs} numbers, but {wanted}" + ("" if direct else f" {manifest.network_outputs}"),
        part="the network's output",
        slug="action-does-not-fit",
    )
