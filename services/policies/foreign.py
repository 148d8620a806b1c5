"""Files that training code writes and the farm does not read, known by their first bytes, their entries or their name."""

from collections.abc import Collection
from pathlib import PurePosixPath

from api_schemas.policy import WeightsFormat
from services.policies.unfit import UnfitError

FIRST_BYTES = 4096
TAKEN = "its name must end in " + ", ".join(f".{each}" for each in WeightsFormat)
ZIP_START = b"PK\x03\x04"
HDF5_START = b"\x89HDF\r\n\x1a\n"
OLD_TORCH = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
"""The number that torch's format before 1.6 begins with, as a pickle."""
PICKLED_SUFFIXES = {
    ".pkl": "a pickle",
    ".pickle": "a pickle",
    ".joblib": "a joblib pickle",
    ".npy": "a numpy file, which may hold pickles",
    ".npz": "a numpy archive, which may hold pickles",
    ".pt": "a torch file",
    ".pth": "a torch file",
    ".ckpt": "a checkpoint",
    ".jit": "TorchScript",
    ".ts": "TorchScript",
    ".pt2": "a torch.export archive",
    ".h5": "an HDF5 file",
    ".keras": "a Keras file",
}


def named_foreign(filename: str | None) -> UnfitError:
    """The error for a name that is none of the accepted ones."""
    suffix = PurePosixPath(filename or "").suffix.lower()
    if suffix in PICKLED_SUFFIXES:
        what = PICKLED_SUFFIXES[suffix]
        return UnfitError(
            f"{what} is not taken, because reading it can run code that it carries", slug="unknown-weights-format", pack=True
        )
    return UnfitError(
        f"the weights' file is named {filename!r:.150}; {TAKEN}",
        slug="unknown-weights-format",
        instead="export the network, or let `trifarm pack FILE` make a policy of it on your own machine",
    )


def check_start(start: bytes, kind: WeightsFormat) -> None:
    """Raises when the first bytes of a file say that it is another format than its name does.

    Args:
        start: the first ``FIRST_BYTES`` bytes of the file, or all of a shorter one.
        kind: the format by its name.

    Raises:
        UnfitError: names the format.
    """
    if _is_pickle(start):
        raise UnfitError("it is a pickle, which can run code when it is read", slug="pickle", pack=True)
    if start.startswith(HDF5_START):
        raise UnfitError("it is an HDF5 file", slug="wrong-format", pack=True)
    if (start.startswith(ZIP_START)) != (kind == WeightsFormat.ZIP):
        if kind == WeightsFormat.ZIP:
            raise UnfitError(
                "it does not begin as a zip archive", slug="archive-malformed", instead="send what model.save() wrote"
            )
        raise UnfitError(
            f"it is a zip archive (stable-baselines3, torch, TorchScript or torch.export), not {kind}",
            slug="wrong-format",
            instead="give an archive of stable-baselines3 a name that ends in .zip; for every other run `trifarm pack FILE` on "
            "your own machine",
        )


def _is_pickle(start: bytes) -> bool:
    """Whether these are the first bytes of a pickle: the protocol's mark, or the opcodes of protocol 0 that name something."""
    if start[:1] == b"\x80" and start[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        # A safetensors file may begin with the same two bytes, by the length of its header; then a JSON object follows.
        return start[8:9] != b"{"
    lines = start.split(b"\n", 2)
    return len(lines) == 3 and lines[0][:1] in (b"c", b"(") and lines[0][1:].replace(b".", b"").replace(b"_", b"").isalnum()


def check_entries(names: Collection[str]) -> None:
    """Raises when the entries of a zip archive say that it is one of the formats that carry code.

    Raises:
        UnfitError: names the format and the entry.
    """
    if "parameters" in names and "parameter_list" in names:
        raise UnfitError(
            "the archive is of stable-baselines2 (TensorFlow), not of stable-baselines3", part="entry parameter_list",
            slug="archive-entry", pack=True,
        )  # fmt: skip
    tails = {name.partition("/")[2] or name: name for name in names}
    for tail, what, slug in (
        ("constants.pkl", "TorchScript", "torchscript"),
        ("archive_format", "a torch.export archive (.pt2)", "torch-export"),
        ("models/model.json", "a torch.export archive (.pt2)", "torch-export"),
        ("serialized_exported_program.json", "a torch.export archive (.pt2)", "torch-export"),
    ):
        if tail in tails:
            raise UnfitError(f"the archive is {what}, which carries code", part=f"entry {tails[tail]}", slug=slug, pack=True)
    if any(tail.startswith("code/") for tail in tails):
        raise UnfitError("the archive is TorchScript, which carries code", slug="torchscript", pack=True)
    if "data.pkl" in tails and "data" not in names:
        raise UnfitError(
            "the archive is a torch checkpoint, that is a pickle with tensors", part=f"entry {tails['data.pkl']}", slug="pickle",
            pack=True,
        )  # fmt: skip
