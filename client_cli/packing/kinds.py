"""Which file is what, by its content: the kinds that are packed, and those that are not, each with the next command."""

import json
import re
import zipfile
from pathlib import Path

from api_schemas.policy import PolicyManifest
from client_cli.terminal.errors import UsageProblem

FORMATS = (
    *("auto", "sb3", "sb2", "rl-games", "rsl-rl", "skrl", "state-dict"),
    *("torchscript", "torch-export", "onnx", "hugging-face"),
)
PLAIN = "state-dict"
CHECKPOINT = "checkpoint"
"""A file of ``torch.save``, of which library its keys say."""
HDF5 = b"\x89HDF\r\n\x1a\n"
SUFFIXES = (
    ".pt",
    ".pth",
    ".ckpt",
    ".pt2",
    ".jit",
    ".ts",
    ".zip",
    ".onnx",
    ".safetensors",
    ".npz",
    ".bin",
    ".tar",
    ".cleanrl_model",
)
"""What a folder of checkpoints is searched for."""
FARM_TENSOR = re.compile(r"(layer|encoder)\d+\.(weight|bias)|recurrent(_norm)?\.\w+")


def kind_of(path: Path) -> str:
    """The kind of a file or folder.

    Raises:
        UsageProblem: it is of a kind that is not packed; the message says what to do with it.
    """
    if path.is_dir():
        if (path / "config.json").is_file():
            return "hugging-face"
        raise UsageProblem(f"{path} is a folder without config.json; 'trifarm pack {path}' packs every checkpoint in it")
    start = _start(path)
    if start.startswith(HDF5):
        raise UsageProblem(
            f"{path.name} is an HDF5 file, as Keras writes it: export it in its own environment with "
            f"'python -m tf2onnx.convert --keras {path.name} --output policy.onnx', then 'trifarm check policy.onnx'"
        )
    if path.suffix == ".onnx" or (start[:1] == b"\x08" and start[2:3] in (b"\x12", b"\x3a")):
        return "onnx"
    if path.suffix == ".npz" or (len(start) > 8 and start[8:9] == b"{" and int.from_bytes(start[:8], "little") < 2**32):
        return PLAIN
    return _kind_of_archive(path) if zipfile.is_zipfile(path) else CHECKPOINT


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(64)


def _kind_of_archive(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if "policy.pth" in names and "data" in names:
        return "sb3"
    if "parameters" in names and "parameter_list" in names:
        return "sb2"
    if any(name.endswith("archive_format") or "/models/" in f"/{name}" for name in names):
        return "torch-export"
    if any(name.endswith("constants.pkl") for name in names):
        return "torchscript"
    if any(name.endswith("data.pkl") for name in names):
        return CHECKPOINT
    listed = ", ".join(names[:5])
    raise UsageProblem(
        f"{path.name} is a zip archive of no known kind (entries {listed}); give the checkpoint inside, or export the network "
        "with torch.jit.script(network).save('policy.pt') and pack that"
    )


def check_is(path: Path, form: str) -> None:
    """Raises where a file cannot be what the user says it is.

    Raises:
        UsageProblem: names what it is instead.
    """
    found = kind_of(path)
    generic = {CHECKPOINT: ("rl-games", "rsl-rl", "skrl", PLAIN)}
    if form != found and form not in generic.get(found, ()):
        means = found if found != CHECKPOINT else "a torch checkpoint"
        raise UsageProblem(f"{path.name} is {_article(means)}, not --format {form}; leave --format out")


def _article(kind: str) -> str:
    words = {
        "sb3": "an archive of stable-baselines3",
        "sb2": "an archive of stable-baselines2",
        "onnx": "an ONNX graph",
        PLAIN: "a file of plain arrays",
        "torchscript": "a TorchScript program",
        "torch-export": "a torch.export archive",
        "hugging-face": "a Hugging Face folder",
    }
    return words.get(kind, kind)


def already_packed(path: Path, names: list[str], manifest: PolicyManifest) -> UsageProblem | None:
    """The error for a safetensors file that is the farm's own form already; None for others."""
    around = ("observation_", "running_", "torque_", "whitening_")
    if not names or not all(FARM_TENSOR.fullmatch(name) or name.startswith(around) for name in names):
        return None
    return UsageProblem(f"{path.name} is a policy already: {next_command(path, manifest)}")


def next_command(path: Path, manifest: PolicyManifest) -> str:
    """What to do with a file that needs no packing."""
    return f"'trifarm check {path.name} --layout {manifest.name}' (or --manifest FILE) says so, 'trifarm submit' sends it"


def config_of(folder: Path) -> dict[str, object]:
    """``config.json`` of a Hugging Face folder.

    Raises:
        UsageProblem: it is not JSON, or there are no weights beside it.
    """
    try:
        found = json.loads((folder / "config.json").read_text())
    except ValueError as error:
        raise UsageProblem(f"{folder}/config.json is not JSON: {error}") from error
    if not (folder / "model.safetensors").is_file():
        raise UsageProblem(f"{folder} has a config.json and no model.safetensors beside it; download the whole folder")
    return found if isinstance(found, dict) else {}
