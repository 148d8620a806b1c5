"""A policy trained in trifarm's environments, saved so that it is submitted as it lies: the environment writes the manifest."""

import copy
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from api_schemas.policy import InputScaling, PolicyManifest
from api_schemas.policy_network import FrameStack
from client_cli.packing.packed_files import Packed, pack_to
from client_cli.packing.quiet import quiet
from client_cli.packing.reading import Statement
from client_cli.terminal.errors import UsageProblem

__all__ = ["save_policy"]

_INSIDE = ("manifest", "venv", "env", "_env", "_unwrapped", "unwrapped", "environment")
"""Where wrappers of Gymnasium, stable-baselines3, skrl and rsl_rl keep what they wrap."""
_HARMLESS = frozenset({"ClipAction", "FlattenObservation"})
_CHANGING = frozenset(
    {
        *("NormalizeObservation", "FrameStackObservation", "TransformObservation", "RescaleAction", "StickyAction"),
        *("DelayObservation", "MaxAndSkipObservation", "VecTransposeImage", "VecExtractDictObs"),
    }
)
"""Wrappers that are neither ObservationWrapper nor ActionWrapper and change what is seen or done all the same."""
_ACTIVATIONS = {"ELU": "elu", "ReLU": "relu", "Tanh": "tanh"}


def save_policy(model: Any, env: Any, path: Path | str) -> Packed:
    """Saves a trained policy with the manifest of the environment that it was trained in, compared with the original.

    Layout, meaning and size of actions, rate and delay are the environment's; layers and normalisation are the model's.
    ``trifarm submit PATH --task TASK`` needs nothing more.

    Args:
        model: a model of stable-baselines3 or sb3-contrib, a runner of rsl_rl, an agent of skrl, or a torch module that takes
            observations (1, n) and gives actions in the environment's units (1, 9).
        env: the environment, however wrapped, in processes of its own, too; ``VecNormalize`` and ``VecFrameStack`` are written
            into the manifest.
        path: where; its suffix becomes that of what is written (``.safetensors``, or ``.onnx`` for a module).

    Raises:
        ClientError: it is none of trifarm's environments, a wrapper changes what is seen, or the model cannot be packed.

    Example:
        >>> import torch, trifarm
        >>> env = trifarm.TrifingerEnv("push")
        >>> actor = torch.nn.Sequential(torch.nn.Linear(75, 32), torch.nn.Tanh(), torch.nn.Linear(32, 9))
        >>> trifarm.save_policy(actor, env, "mine").weights.name
        'mine.onnx'
    """
    manifest, out = manifest_of(env), Path(path)
    manifest = manifest.model_copy(update={"name": out.stem[:100] or "unnamed"})
    statistics = next((each for each in _layers(env) if type(each).__name__ == "VecNormalize" and each.norm_obs), None)
    if statistics is not None and not _is_stable(model):
        manifest = manifest.model_copy(update={"input_scaling": _scaling_of(statistics)})
    with tempfile.TemporaryDirectory(prefix="trifarm-save-") as folder:
        files, activation = _written(model, manifest, statistics, Path(folder))
        suffix = ".onnx" if files[0].name == "module.pt" else ".safetensors"
        target = out if out.suffix == suffix else out.with_name(out.name + suffix)
        return pack_to(target, files, Statement(manifest, activation=activation))


def manifest_of(env: Any) -> PolicyManifest:
    """The manifest of an environment of trifarm, with the stack of observations that a wrapper makes.

    Raises:
        UsageProblem: there is none inside, or a wrapper changes what the policy sees or does.
    """
    found, stack = None, None
    for each in _layers(env):
        if isinstance(each, PolicyManifest):
            found = each
            break
        name = type(each).__name__
        if name == "VecFrameStack":
            stack = FrameStack(count=each.stacked_obs.n_stack, fill="zeros")
        elif (changing := name if _changes(each) else _changing_in_processes(each)) is not None:
            raise UsageProblem(
                f"the environment is wrapped by {changing}, which changes what the policy sees or does and cannot be written "
                "into a manifest: train without it, or with VecNormalize or VecFrameStack of stable-baselines3"
            )
    if found is None:
        raise UsageProblem(
            f"{type(env).__name__} is none of trifarm's environments, nor wraps one; 'trifarm pack' takes policies of others"
        )
    return found if stack is None else found.model_copy(update={"frame_stack": stack})


def _layers(env: Any) -> Iterator[Any]:
    """The environment and all that it wraps, from outside."""
    seen: list[int] = []
    while env is not None and id(env) not in seen:
        seen.append(id(env))
        yield env
        own = vars(env) if hasattr(env, "__dict__") else {}
        inner = env.manifest if isinstance(getattr(type(env), "manifest", None), property) else None
        if inner is None:
            inner = next((own[name] for name in _INSIDE if name in own), None)
        if inner is None and own.get("envs"):
            inner = own["envs"][0]
        if inner is None and _is_in_processes(env):
            inner = env.get_attr("manifest")[0]
        env = inner


def _changes(env: Any) -> bool:
    """Whether a wrapper changes what a policy sees or does, so that a manifest would have to say how."""
    from gymnasium import ActionWrapper, ObservationWrapper
    from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper

    kinds = ObservationWrapper | ActionWrapper | VectorObservationWrapper | VectorActionWrapper
    name = type(env).__name__
    return name not in _HARMLESS and (isinstance(env, kinds) or name in _CHANGING)


class _AsksEach(type):
    def __instancecheck__(cls, env: object) -> bool:
        return _changes(env)


class Changing(metaclass=_AsksEach):
    """Every wrapper that changes what a policy sees or does is one of these; a class crosses to other processes."""


def _is_in_processes(env: Any) -> bool:
    """Whether the environments run in processes of their own, of which stable-baselines3 and Gymnasium have a class each."""
    own = vars(env) if hasattr(env, "__dict__") else {}
    return "remotes" in own or "parent_pipes" in own


def _changing_in_processes(env: Any) -> str | None:
    """The wrappers inside of other processes, from outside, if one of them changes what is seen or done."""
    if not _is_in_processes(env):
        return None
    if hasattr(env, "env_is_wrapped"):
        asked = zip(env.env_is_wrapped(Changing), env.env_method("__str__"), strict=True)
        return next((" and ".join(_names(text)) for changing, text in asked if changing), None)
    changing = [name for text in env.call("__str__") for name in _names(text) if _is_named_changing(name)]
    return changing[0] if changing else None


def _names(text: str) -> list[str]:
    """The wrappers in what Gymnasium prints of an environment, ``<Outer<Inner<TrifingerEnv instance>>>``."""
    return re.findall(r"<(\w+)(?=<)", text)


def _is_named_changing(name: str) -> bool:
    """The same by a wrapper's name alone."""
    import gymnasium

    known = getattr(gymnasium.wrappers, name, None)
    kinds = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper)
    return name not in _HARMLESS and (name in _CHANGING or (isinstance(known, type) and issubclass(known, kinds)))


def _scaling_of(statistics: Any) -> InputScaling:
    """What ``VecNormalize`` does to observations, as a manifest says it."""
    mean, variance = (tuple(float(each) for each in values) for values in (statistics.obs_rms.mean, statistics.obs_rms.var))
    return InputScaling(mean=mean, variance=variance, epsilon=statistics.epsilon, clip=float(statistics.clip_obs))


def _libraries(model: Any) -> set[str]:
    return {each.__module__.partition(".")[0] for each in type(model).__mro__}


def _is_stable(model: Any) -> bool:
    return bool(_libraries(model) & {"stable_baselines3", "sb3_contrib"})


def _written(model: Any, manifest: PolicyManifest, statistics: Any, folder: Path) -> tuple[list[Path], str | None]:
    """The model as its library saves it, and the activation between its layers where it is one.

    ``statistics`` are those of the environment, for an archive whose model was loaded without one.

    Raises:
        UsageProblem: it is of no known library.
    """
    import torch

    if _is_stable(model):
        return _archive(model, statistics, folder), None
    if hasattr(model, "alg") and hasattr(model, "get_inference_policy"):
        file = folder / "model_0.pt"
        torch.save({"iter": 0, "infos": None} | _rsl_rl_state(model), file)
        return [file], _activation_of(model.alg)
    if "skrl" in _libraries(model):
        model.save(str(folder / "agent_0.pt"))
        return [folder / "agent_0.pt"], _activation_of(model)
    if isinstance(model, torch.nn.Module):
        return [_module(model, manifest, folder / "module.pt")], None
    raise UsageProblem(
        f"a {type(model).__name__} is no model of stable-baselines3, runner of rsl_rl, agent of skrl or torch module; wrap its "
        "actor in a torch module that takes observations (1, n) and gives actions (1, 9)"
    )


def _archive(model: Any, statistics: Any, folder: Path) -> list[Path]:
    model.save(folder / "model.zip")
    statistics = model.get_vec_normalize_env() or statistics
    if statistics is None:
        return [folder / "model.zip"]
    statistics.save(str(folder / "vec_normalize.pkl"))
    return [folder / "model.zip", folder / "vec_normalize.pkl"]


def _rsl_rl_state(runner: Any) -> dict[str, Any]:
    """What rsl_rl's runner saves, of versions before and since its algorithm does so itself."""
    if hasattr(runner.alg, "save"):
        return dict(runner.alg.save())
    policy = getattr(runner.alg, "policy", None) or runner.alg.actor_critic
    state = {"model_state_dict": policy.state_dict()}
    if hasattr(getattr(runner, "obs_normalizer", None), "_mean"):
        state["obs_norm_state_dict"] = runner.obs_normalizer.state_dict()
    return state


def _activation_of(owner: Any) -> str | None:
    """The one activation among the modules of an actor; None where there are several or none."""
    import torch

    places = ("actor", "policy", "actor_critic")
    actor = next((found for name in places if isinstance(found := getattr(owner, name, None), torch.nn.Module)), None)
    if actor is None:
        return None
    names = {type(each).__name__ for each in actor.modules()} & set(_ACTIVATIONS)
    return _ACTIVATIONS[names.pop()] if len(names) == 1 else None


def _module(model: Any, manifest: PolicyManifest, file: Path) -> Path:
    import torch

    try:
        own = copy.deepcopy(model).eval().cpu()
        with quiet(), torch.no_grad():
            traced: Any = torch.jit.trace(own, torch.zeros(1, manifest.network_inputs), check_trace=False)
            alike = [torch.allclose(own(row), traced(row), rtol=1e-4, atol=1e-5) for row in _rows(manifest.network_inputs)]
    except Exception as error:
        raise UsageProblem(
            f"the module cannot be run on one observation of shape (1, {manifest.network_inputs}): {str(error)[:200]}"
        ) from error
    if not all(alike):
        raise UsageProblem(
            "the module branches or remembers, so that one pass through it is not what it does: save torch.jit.script(module), "
            "and pack that with 'trifarm pack'"
        )
    with quiet():
        torch.jit.save(traced, str(file))
    return file


def _rows(inputs: int) -> Any:
    """Observations by chance, shape (100, 1, inputs), the same each time."""
    import torch

    return 3.0 * torch.randn(100, 1, inputs, generator=torch.Generator().manual_seed(0))
