"""Files that other libraries wrote × check, pack, submit: ``python -m tests.benchmarks.foreign_policies --out FILE [--farm]``.

Each kind of file is made by the library that writes it (stable-baselines3, sb3-contrib, rl_games, rsl_rl, skrl, torch from
this environment; LeRobot, which wants another torch, from one of its own that is made once in the user's cache, unless
``--lerobot PYTHON`` names one; stable-baselines2 and Keras by hand). It goes through the command line as a user would type it,
with and without ``--json``. A row says the words of each refusal, the largest difference from the original, how many lines came
out at most, and with ``--farm`` what one trial on the farm that ``trifarm`` finds came to. Rows are written as they come; a
second run goes on where the first was stopped.
"""

import argparse
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import safetensors.torch
import torch
from torch import nn

from api_schemas.policy import LAYOUTS, PolicyManifest
from client_cli.main import run
from tests.benchmarks import own_environment

ROOT = Path(__file__).resolve().parents[2]
SCALE = 0.396
MANIFEST = LAYOUTS["pose"].model_copy(update={"name": "foreign"})
N = MANIFEST.observation_size
MOST_LINES = 15
LEROBOT = ("lerobot==0.4.4",)


class Actor(nn.Module):
    """A network of a class of the user's own."""

    def __init__(self) -> None:
        super().__init__()
        self.net = mlp(nn.ELU)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.net(x)


class Hiding(nn.Module):
    """Keeps memory to itself."""

    last: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.net = mlp(nn.ELU)
        self.register_buffer("last", torch.zeros(1, 9))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        self.last[:] = 0.5 * self.last + 0.5 * self.net(x)
        return self.last + 0.0


def mlp(activation: type[nn.Module], *, takes: int = N, gives: int = 9) -> nn.Sequential:
    """A small network."""
    return nn.Sequential(nn.Linear(takes, 24), activation(), nn.Linear(24, 24), activation(), nn.Linear(24, gives))


def stable(algorithm: str, *, normalised: bool = False) -> Callable[[Path], tuple[list[str], list[str]]]:
    """A short training of stable-baselines3 or sb3-contrib."""

    def make(folder: Path) -> tuple[list[str], list[str]]:
        import sb3_contrib
        import stable_baselines3
        from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

        from tests.unit.client_cli.packing.toy_env import ToyEnv

        env: Any = DummyVecEnv([lambda: ToyEnv(N)])
        env = VecNormalize(env) if normalised else env
        library, policy = (stable_baselines3, "MlpPolicy") if algorithm != "RecurrentPPO" else (sb3_contrib, "MlpLstmPolicy")
        kind = {"n_steps": 16} if algorithm in ("PPO", "A2C", "RecurrentPPO") else {"learning_starts": 8, "buffer_size": 100}
        kind |= {"batch_size": 16} if algorithm in ("PPO", "RecurrentPPO") else {}
        model = getattr(library, algorithm)(policy, env, seed=0, device="cpu", **kind).learn(32)
        model.save(folder / "model.zip")
        if normalised:
            env.save(str(folder / "vec_normalize.pkl"))
        return ["model.zip", *(["vec_normalize.pkl"] if normalised else [])], []

    return make


def library(name: str, file: str, *more: Any) -> Callable[[Path], tuple[list[str], list[str]]]:
    """A few steps of training of a library of ``libraries``."""

    def make(folder: Path) -> tuple[list[str], list[str]]:
        from tests.unit.client_cli.packing import libraries

        getattr(libraries, name)(folder / file, N, *more)
        return [file], ["--activation", "elu"]

    return make


def state_dict(folder: Path) -> tuple[list[str], list[str]]:
    torch.save(nn.ModuleDict({"actor": mlp(nn.Tanh), "critic": mlp(nn.Tanh, gives=1)}).state_dict(), folder / "weights.pt")
    return ["weights.pt"], ["--architecture", "actor.0,actor.2,actor.4", "--activation", "tanh"]


def cleanrl_ppo(folder: Path) -> tuple[list[str], list[str]]:
    """The names of CleanRL's ppo_continuous_action.py."""
    agent = nn.Module()
    agent.critic, agent.actor_mean = mlp(nn.Tanh, gives=1), mlp(nn.Tanh)
    agent.actor_logstd = nn.Parameter(torch.zeros(1, 9))
    torch.save(agent.state_dict(), folder / "ppo_continuous_action.cleanrl_model")
    return ["ppo_continuous_action.cleanrl_model"], [
        "--architecture",
        "actor_mean.0,actor_mean.2,actor_mean.4",
        "--activation",
        "tanh",
    ]


def cleanrl_sac(stated: bool) -> Callable[[Path], tuple[list[str], list[str]]]:
    """The names of CleanRL's sac_continuous_action.py, with and without saying how its actions are scaled."""

    def make(folder: Path) -> tuple[list[str], list[str]]:
        actor = nn.Module()
        actor.fc1, actor.fc2, actor.fc_mean, actor.fc_logstd = (
            nn.Linear(N, 24),
            nn.Linear(24, 24),
            nn.Linear(24, 9),
            nn.Linear(24, 9),
        )
        actor.register_buffer("action_scale", torch.full((9,), 0.8))
        actor.register_buffer("action_bias", torch.full((9,), 0.1))
        torch.save(actor.state_dict(), folder / "actor.pt")
        options = ["--architecture", "fc1,fc2,fc_mean", "--activation", "relu"]
        return ["actor.pt"], options + (["--action-normaliser", "tanh-scale-bias:action_scale,action_bias"] if stated else [])

    return make


def torch_script(module: nn.Module) -> Callable[[Path], tuple[list[str], list[str]]]:
    def make(folder: Path) -> tuple[list[str], list[str]]:
        torch.jit.script(module).save(str(folder / "policy.pt"))
        return ["policy.pt"], []

    return make


def exported(folder: Path) -> tuple[list[str], list[str]]:
    torch.export.save(torch.export.export(Actor(), (torch.zeros(1, N),)), folder / "policy.pt2")
    return ["policy.pt2"], []


def whole_module(folder: Path) -> tuple[list[str], list[str]]:
    torch.save(Actor(), folder / "module.pt")
    return ["module.pt"], []


def graph(*, apart: bool) -> Callable[[Path], tuple[list[str], list[str]]]:
    def make(folder: Path) -> tuple[list[str], list[str]]:
        file = io.BytesIO()
        torch.onnx.export(Actor().eval(), (torch.zeros(1, N),), file, dynamo=False, opset_version=17)  # pyrefly: ignore[bad-argument-type]
        model = onnx.load_model_from_string(file.getvalue())
        options: dict[str, Any] = {"save_as_external_data": True, "location": "weights.bin", "size_threshold": 0} if apart else {}
        onnx.save(model, folder / "policy.onnx", **options)
        return ["policy.onnx"], []

    return make


def plain_safetensors(folder: Path) -> tuple[list[str], list[str]]:
    safetensors.torch.save_file(mlp(nn.Tanh).state_dict(), folder / "model.safetensors")
    return ["model.safetensors"], ["--architecture", "0,2,4", "--activation", "tanh"]


def hub_folder(folder: Path) -> tuple[list[str], list[str]]:
    (folder / "hub").mkdir()
    (folder / "hub" / "config.json").write_text('{"hidden": 24}')
    safetensors.torch.save_file(mlp(nn.Tanh).state_dict(), folder / "hub" / "model.safetensors")
    return ["hub"], ["--architecture", "0,2,4", "--activation", "tanh"]


def arrays(folder: Path) -> tuple[list[str], list[str]]:
    np.savez(folder / "weights.npz", **{name: each.numpy() for name, each in mlp(nn.Tanh).state_dict().items()})
    return ["weights.npz"], ["--architecture", "0,2,4", "--activation", "tanh"]


def old_archive(folder: Path, low: np.ndarray = -np.ones(9), high: np.ndarray = np.ones(9)) -> tuple[list[str], list[str]]:
    """What stable-baselines2's PPO2 with MlpPolicy saves, by hand, for an action space of these bounds."""
    rng, names, values = np.random.default_rng(0), [], {}
    for name, shape in (
        ("pi_fc0", (N, 24)),
        ("vf_fc0", (N, 24)),
        ("pi_fc1", (24, 24)),
        ("vf", (24, 1)),
        ("pi", (24, 9)),
        ("q", (24, 9)),
    ):
        for last, size in (("w", shape), ("b", shape[1:])):
            names.append(f"model/{name}/{last}:0")
            values[names[-1]] = rng.normal(size=size).astype(np.float32) * 0.2
    names.append("model/pi/logstd:0")
    values[names[-1]] = np.zeros((1, 9), np.float32)
    packed = io.BytesIO()
    np.savez(packed, **values)
    with zipfile.ZipFile(folder / "ppo2.zip", "w") as archive:
        space = {"low": str(low), "high": str(high), ":serialized:": "AAAA"}
        archive.writestr("data", json.dumps({"gamma": 0.99, "action_space": space, "policy_kwargs": {}}))
        archive.writestr("parameters", packed.getvalue())
        archive.writestr("parameter_list", json.dumps(names))
    return ["ppo2.zip"], []


def keras(folder: Path) -> tuple[list[str], list[str]]:
    (folder / "actor.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(400))
    return ["actor.h5"], []


def pickled(folder: Path) -> tuple[list[str], list[str]]:
    import pickle

    (folder / "params.pkl").write_bytes(pickle.dumps({"params": [np.zeros(3)]}))
    return ["params.pkl"], []


def lerobot(kind: str) -> Callable[[Path], tuple[list[str], list[str]]]:
    """A policy that LeRobot wrote; raises LookupError where there is no LeRobot."""

    def make(folder: Path) -> tuple[list[str], list[str]]:
        python = os.environ.get("LEROBOT_PYTHON") or str(own_environment.python_of("lerobot"))
        if "LEROBOT_PYTHON" not in os.environ and (why_not := own_environment.missing("lerobot", LEROBOT)) is not None:
            raise LookupError(why_not)
        maker = str(Path(__file__).with_name("lerobot_policies.py"))
        subprocess.run([python, "-W", "ignore", maker, str(folder), "18", str(N - 18)], check=True, capture_output=True)
        return [kind], ["--python", python]

    return make


def wrong_width(folder: Path) -> tuple[list[str], list[str]]:
    torch.jit.script(mlp(nn.ELU, takes=97)).save(str(folder / "policy.pt"))
    return ["policy.pt"], []


KINDS: dict[str, Callable[[Path], tuple[list[str], list[str]]]] = {
    "stable-baselines3 PPO": stable("PPO"),
    "stable-baselines3 PPO with VecNormalize": stable("PPO", normalised=True),
    "stable-baselines3 A2C": stable("A2C"),
    "stable-baselines3 SAC": stable("SAC"),
    "stable-baselines3 TD3": stable("TD3"),
    "stable-baselines3 DDPG": stable("DDPG"),
    "sb3-contrib RecurrentPPO with VecNormalize": stable("RecurrentPPO", normalised=True),
    "stable-baselines2 PPO2 (by hand)": old_archive,
    "rl_games": library("rl_games", "last_cube_ep_2.pth", None),
    "rl_games LSTM": library("rl_games", "last_cube_ep_2.pth", "lstm"),
    "rsl_rl": library("rsl_rl", "model_2.pt", None),
    "rsl_rl LSTM": library("rsl_rl", "model_2.pt", "lstm"),
    "skrl PPO": library("skrl", "agent_32.pt"),
    "CleanRL PPO (its names)": cleanrl_ppo,
    "CleanRL SAC (its names), actions unsaid": cleanrl_sac(stated=False),
    "CleanRL SAC (its names)": cleanrl_sac(stated=True),
    "torch state_dict": state_dict,
    "torch.save(module)": whole_module,
    "TorchScript": torch_script(Actor()),
    "TorchScript that hides its memory": torch_script(Hiding()),
    "TorchScript of another width": wrong_width,
    "torch.export": exported,
    "ONNX in one file": graph(apart=False),
    "ONNX with external data": graph(apart=True),
    "safetensors with torch's names": plain_safetensors,
    "Hugging Face folder": hub_folder,
    "LeRobot ACT": lerobot("act"),
    "LeRobot diffusion": lerobot("diffusion"),
    "numpy arrays (.npz)": arrays,
    "Keras HDF5 (by hand)": keras,
    "pickle of arrays": pickled,
}


def typed(*arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the command line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            run(list(arguments))
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue(), err.getvalue()


def is_one_document(text: str) -> bool:
    """Whether a text is one JSON document and nothing besides."""
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def said(code: int, out: str, err: str, folder: Path | None = None) -> str:
    """A command's words: what it refused, or its first line, with the files' names and not their folder's."""
    lines = [line for line in (err if code else out).splitlines() if line and not line.startswith(("note:", "warning:"))]
    return (lines or ["nothing"])[0].replace(f"{folder}/", "")[:600]


def row_of(kind: str, folder: Path, *, farm: bool) -> dict[str, Any]:
    """What became of one kind of file."""
    try:
        names, options = KINDS[kind](folder)
    except LookupError as missing:
        return {"kind": kind, "skipped": str(missing)}
    manifest = folder / "robot.json"
    manifest.write_text(PolicyManifest.model_dump_json(MANIFEST))
    files, stated = [str(folder / name) for name in names], ["--manifest", str(manifest)]
    check = typed("check", files[0], *stated, "--no-try")
    packing = ["pack", *files, *stated, *options, "--scale", str(SCALE), "--no-try"]
    pack, pack_json = typed(*packing), typed(*packing, "--json")
    done = json.loads(pack_json[1]) if pack_json[0] == 0 else {}
    row = {
        "kind": kind,
        "check": "accepted" if check[0] == 0 else said(*check, folder),
        "pack": f"packed as {Path(done['weights']).suffix}" if done else said(*pack, folder),
        "largest_difference": done.get("largest_difference"),
        "unused": len(done.get("unused", ())),
        "lines": max(len((each[1] + each[2]).splitlines()) for each in (check, pack)),
        "json_is_one_document": is_one_document(pack_json[1]),
    }
    if farm and (done or check[0] == 0):
        sent = [done["weights"]] if done else [files[0], *stated]
        submit = typed("submit", *sent, "--task", "push", "--trials", "1", "--json")
        row["json_is_one_document"] &= is_one_document(submit[1])
        row["submit"] = json.loads(submit[1])["job_id"] if submit[0] == 0 else said(*submit, folder)
    return row


def ends(rows: list[dict[str, Any]]) -> None:
    """Puts what the trials came to in place of the jobs' ids."""
    for row in rows:
        if row.get("submit") and " " not in row["submit"]:
            code, out, _ = typed("report", row["submit"], "--json")
            found = json.loads(out) if code == 0 else {}
            row["trial"] = (
                f"{found['trials']} of 1 trial done, {found['successes']} succeeded" if "trials" in found else "not over"
            )


def main(arguments: list[str] | None = None) -> int:
    """Make, try, print, keep."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.foreign_policies", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, required=True, help="JSON; rows that are in it are not made again")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--farm", action="store_true", help="submit each to the farm that trifarm finds")
    parser.add_argument("--lerobot", type=Path, help="interpreter of an environment that has LeRobot")
    asked = parser.parse_args(arguments)
    if asked.lerobot:
        os.environ["LEROBOT_PYTHON"] = str(asked.lerobot)
    torch.set_num_threads(1)
    torch.manual_seed(0)
    rows = json.loads(asked.out.read_text())["rows"] if asked.out.exists() else []
    for kind in asked.kinds:
        if any(row["kind"] == kind and "skipped" not in row for row in rows):
            continue
        with tempfile.TemporaryDirectory(prefix="trifarm-foreign-") as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what libraries say of each other's versions
            row = row_of(kind, Path(folder), farm=asked.farm)
        rows = [each for each in rows if each["kind"] != kind] + [row]
        asked.out.write_text(json.dumps({"manifest": MANIFEST.name, "scale": SCALE, "rows": rows}, indent=1) + "\n")
        print(json.dumps(row), flush=True)
    ends(rows)
    asked.out.write_text(json.dumps({"manifest": MANIFEST.name, "scale": SCALE, "rows": rows}, indent=1) + "\n")
    wrong = [row["kind"] for row in rows if row.get("lines", 0) > MOST_LINES or not row.get("json_is_one_document", True)]
    skipped = [row["kind"] for row in rows if "skipped" in row]
    print(f"{len(rows)} kinds, {len(skipped)} skipped; too long or more than one document: {', '.join(wrong) or 'none'}")
    return int(bool(wrong or skipped))


if __name__ == "__main__":
    sys.exit(main())
