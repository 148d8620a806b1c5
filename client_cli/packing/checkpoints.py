"""Checkpoints of rl_games, rsl_rl, skrl and plain state dicts: which tensors are the actor's, in which order.

The key layouts are those that the libraries publish: rl_games ``network_builder.py`` and ``running_mean_std.py``, rsl_rl
``modules/actor_critic*.py``, ``models/*.py`` and ``modules/normalization.py``, skrl ``running_standard_scaler.py``.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from api_schemas.policy import InputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead
from client_cli.packing.fitting import misfit
from client_cli.packing.recipe import TINY, Array, Normaliser, Part, Recipe, follows, part
from client_cli.terminal.errors import UsageProblem

State = Mapping[str, Any]
RL_GAMES = "a2c_network."
RSL_RL_EPSILON = 1e-2
SKRL_EPSILON = 1e-8
STATISTICS = ("mean", "var", "std")
"""Words in the names of an observation's statistics."""
NO_NORMALISER = "none"
CLIP = 5.0
"""Bound of rl_games' and skrl's normalised observations."""


def arrays(state: State) -> dict[str, Array]:
    """The tensors of a state dict as arrays; whatever else lies in it is left out.

    ``torch.compile`` puts a word before the names of what it compiled, and numpy has no bfloat16.
    """
    tensors = {name.replace("_orig_mod.", ""): value.detach().cpu() for name, value in state.items() if hasattr(value, "detach")}
    return {name: (each.float() if "bfloat16" in str(each.dtype) else each).numpy() for name, each in tensors.items()}


def all_tensors(content: State, prefix: str = "") -> dict[str, Array]:
    """Every tensor of a file by its dotted name, whatever it lies in."""
    found: dict[str, Array] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            found |= all_tensors(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            found[f"{prefix}{name}"] = value
        elif hasattr(value, "detach"):
            found |= {f"{prefix}{each}": values for each, values in arrays({str(name): value}).items()}
    return found


def check_width(parts: tuple[Part, ...], manifest: PolicyManifest, file: str) -> None:
    """Raises where a network takes another number of inputs than the manifest gives, though its parts follow each other.

    Raises:
        UsageProblem: names both, and the layouts that fit.
    """
    if parts and parts[0].takes != manifest.network_inputs and follows(parts, parts[0].takes):
        raise misfit(file, [parts[0].takes], manifest)


def parts_of(tensors: Mapping[str, Array]) -> dict[str, Part]:
    """All modules among the tensors that the farm knows, by name, in the file's order."""
    modules: dict[str, dict[str, Array]] = {}
    for name, values in tensors.items():
        prefix, _, last = name.rpartition(".")
        modules.setdefault(prefix, {})[last] = values
    made = {name: part(name, each) for name, each in modules.items()}
    return {name: each for name, each in made.items() if each is not None}


def stated(tensors: Mapping[str, Array], architecture: str) -> tuple[Part, ...]:
    """The parts that the user names, in that order.

    Raises:
        UsageProblem: there is no such module; the message lists those there are.
    """
    known = parts_of(tensors)
    names = [each.strip() for each in architecture.split(",")]
    wrong = [name for name in names if name not in known]
    if wrong:
        raise UsageProblem(f"the file has no module {wrong[0]!r}; it has {_described(known)}")
    return tuple(known[name] for name in names)


def plain(
    state: State, architecture: str | None, manifest: PolicyManifest, normaliser: str | None = None, file: str = "the network"
) -> Recipe:
    """A bare state dict, whose architecture the user must state, and the normaliser too, if there is one.

    Raises:
        UsageProblem: either is missing, or is not in the file.
    """
    tensors = arrays(state) | {name: each for name, each in state.items() if isinstance(each, np.ndarray)}
    inside = [str(name) for name, value in state.items() if isinstance(value, Mapping) and arrays(value)]
    if inside and not parts_of(tensors):
        raise UsageProblem(
            f"the file holds {', '.join(map(str, state))}; {inside[0]!r} looks like the state_dict: save that part alone, "
            f"torch.save(checkpoint[{inside[0]!r}], 'weights.pt')"
        )
    if architecture is None:
        raise UsageProblem(
            "a plain state_dict does not say how its modules are applied: name the actor's in order with --architecture, "
            f"such as actor.0,actor.2,actor.4, and their --activation; the file has {_described(parts_of(tensors))}"
        )
    parts = _checked(stated(tensors, architecture), manifest, file)
    statistics = _stated_normaliser(tensors, manifest, normaliser)
    uses = tuple(each.strip() for each in normaliser.split(",")[:2]) if statistics is not None and normaliser else ()
    return Recipe("state_dict", parts, statistics, uses=uses)


def _stated_normaliser(tensors: Mapping[str, Array], manifest: PolicyManifest, text: str | None) -> Normaliser | None:
    """By ``MEAN,VARIANCE[,EPSILON[,CLIP]]``; a file with what looks like one is not packed without a word about it."""
    sizes, scaling = {manifest.observation_size, manifest.network_inputs}, manifest.input_scaling
    if text is None:
        if not (scaling.mean or scaling.low):  # otherwise the manifest says how observations are scaled
            _check_has_none(tensors, sizes)
        return None
    if text == NO_NORMALISER:
        return None
    mean, spread, *numbers = (*(each.strip() for each in text.split(",")), "")[: max(2, text.count(",") + 1)]
    for name in (mean, spread):
        if name not in tensors or tensors[name].size not in sizes:
            wanted = " or ".join(str(size) for size in sorted(sizes))
            raise UsageProblem(
                f"--normaliser: the file has no {name!r} of {wanted} numbers; write MEAN,VARIANCE[,EPSILON[,CLIP]]"
            )
    if tensors[mean].size != tensors[spread].size:
        raise UsageProblem(f"--normaliser: {mean} has {tensors[mean].size} numbers and {spread} {tensors[spread].size}")
    epsilon, clip = _numbers(text, numbers, scaling)
    values, is_deviation = tensors[spread].ravel().astype(np.float64), "std" in _last(spread)
    return Normaliser(tensors[mean].ravel(), values**2 if is_deviation else values, epsilon, clip, outside=is_deviation)


def _numbers(text: str, given: list[str], scaling: InputScaling) -> tuple[float, float | None]:
    """Epsilon and clip; where they are not given those of the manifest."""
    try:
        numbers = [float(each) for each in given]
    except ValueError:
        numbers = None
    if numbers is None or len(numbers) > 2:
        raise UsageProblem(f"--normaliser {text!r}: after the two names come numbers, at most epsilon and clip")
    epsilon = numbers[0] if numbers else scaling.epsilon
    clip = numbers[1] if len(numbers) > 1 else scaling.clip
    if not (np.isfinite(epsilon) and epsilon >= 0.0 and (clip is None or (np.isfinite(clip) and clip > 0.0))):
        raise UsageProblem(f"--normaliser {text!r}: epsilon must be at least 0 and clip above 0; leave the clip out for none")
    return max(epsilon, TINY), clip


def statistics_alike(tensors: Mapping[str, Array], sizes: Collection[int]) -> tuple[list[str], list[str]]:
    """Names of what looks like an observation's means and spreads."""
    alike = [name for name, each in tensors.items() if each.size in sizes and any(word in _last(name) for word in STATISTICS)]
    means = [name for name in alike if "mean" in _last(name)]
    return means, [name for name in alike if name not in means]


def _check_has_none(tensors: Mapping[str, Array], sizes: Collection[int]) -> None:
    means, spreads = statistics_alike(tensors, sizes)
    if means and spreads:
        raise UsageProblem(
            f"{means[0]} and {spreads[0]} look like a normaliser of the observations, and a plain state_dict does not say how it "
            f"is applied: give --normaliser {means[0]},{spreads[0]},EPSILON,CLIP (what is left out is taken from the manifest), "
            f"or --normaliser {NO_NORMALISER} if the network takes observations as they are"
        )


def _last(name: str) -> str:
    return name.rpartition(".")[2].lower()


def rl_games(content: State, architecture: str | None, manifest: PolicyManifest, file: str) -> Recipe:
    """A checkpoint of rl_games' a2c agents, continuous or multi-discrete."""
    tensors = arrays(content["model"])
    known = {name.removeprefix(RL_GAMES): each for name, each in parts_of(tensors).items()}
    mean, variance = (tensors.get(f"running_mean_std.running_{which}") for which in ("mean", "var"))
    normaliser = None if mean is None or variance is None else Normaliser(mean, variance, 1e-5, CLIP)
    logits = [each for name, each in known.items() if name.startswith("logits.")]
    last = _joined(logits) if logits else known.get("mu")
    if last is None:
        raise UsageProblem("the checkpoint has neither a2c_network.mu nor a2c_network.logits: no actor that can be packed")
    layers = [each for name, each in known.items() if name.startswith("actor_mlp.")]
    memory = [each for name, each in known.items() if each.kind in ("lstm", "gru") and not name.startswith("c_rnn")]
    memory += [each for name, each in known.items() if name in ("layer_norm", "a_layer_norm")]
    parts = stated(tensors, architecture) if architecture else _either(layers, memory, last, manifest, file)
    bins = last.gives // len(logits) if logits else None
    head = ActionHead.BINS if logits else ActionHead.DIRECT
    uses = tuple(f"model.{name}" for name in tensors if name.startswith("running_mean_std."))
    return Recipe("rl_games", parts, normaliser, head=head, bins=bins, clip=None if logits else 1.0, uses=uses)


def _joined(logits: list[Part]) -> Part:
    """The heads of all actuators as one layer."""
    if len({each.gives for each in logits}) != 1:
        raise UsageProblem(f"the actuators have {[each.gives for each in logits]} bins; all must have the same number")
    names = ("weight", "bias")
    return Part("logits", "linear", {name: np.concatenate([each.tensors[name] for each in logits]) for name in names})


def _either(layers: list[Part], memory: list[Part], last: Part, manifest: PolicyManifest, file: str) -> tuple[Part, ...]:
    """Layers before the memory or after it (``before_mlp``): the file does not say which, its shapes do."""
    orders = [[*layers, *memory, last], [*memory, *layers, last]] if memory and layers else [[*layers, *memory, last]]
    fitting = [order for order in orders if follows(order, manifest.network_inputs)]
    if len(fitting) == 1:
        return tuple(fitting[0])
    if fitting:
        names = " or ".join(",".join(each.name for each in order) for order in fitting)
        raise UsageProblem(f"the shapes fit two orders; say which with --architecture: {names}")
    return _checked(tuple(orders[0]), manifest, file)


def rsl_rl(content: State, architecture: str | None, manifest: PolicyManifest, file: str) -> Recipe:
    """A checkpoint of rsl_rl's runners, before and since its actor became a model of its own."""
    tensors = arrays(content.get("actor_state_dict") or content["model_state_dict"])
    before = arrays(content.get("obs_norm_state_dict") or {})
    found = tensors | {f"obs_normalizer.{name}": values for name, values in before.items()}
    known = parts_of(tensors)
    normalisers = ("actor_obs_normalizer", "obs_normalizer")
    normaliser = next((made for name in normalisers if (made := _empirical(found, name)) is not None), None)
    uses = tuple(name for name in all_tensors(content) if name.split(".")[-2:-1] == ["obs_normalizer"] or "obs_norm" in name)
    uses = tuple(name for name in uses if "critic" not in name)
    if architecture:
        return Recipe("rsl_rl", stated(tensors, architecture), normaliser, uses=uses)
    memory = [known[name] for name in ("memory_a.rnn", "rnn.rnn") if name in known]
    layers = [each for name, each in known.items() if name.split(".")[0] in ("actor", "mlp", "student")]
    return Recipe("rsl_rl", _checked((*memory, *layers), manifest, file), normaliser, uses=uses)


def _empirical(tensors: Mapping[str, Array], name: str) -> Normaliser | None:
    mean, deviation = tensors.get(f"{name}._mean"), tensors.get(f"{name}._std")
    if mean is None or deviation is None:
        return None
    return Normaliser(mean.ravel(), deviation.ravel().astype(np.float64) ** 2, RSL_RL_EPSILON, None, outside=True)


def skrl(content: State, architecture: str | None, manifest: PolicyManifest, file: str) -> Recipe:
    """A checkpoint of a skrl agent; what belongs to the value of a shared model is left out."""
    tensors = arrays(content["policy"])
    scalers = (content.get("observation_preprocessor"), content.get("state_preprocessor"))
    scaler = arrays(next((each for each in scalers if each), {}))
    mean, variance = scaler.get("running_mean"), scaler.get("running_variance")
    normaliser = None
    if mean is not None and variance is not None:
        normaliser = Normaliser(mean.ravel(), variance.ravel(), SKRL_EPSILON, CLIP, outside=True)
    words = ("observation_preprocessor.", "state_preprocessor.")
    uses = tuple(name for name in all_tensors(content) if name.startswith(words))
    if architecture:
        return Recipe("skrl", stated(tensors, architecture), normaliser, uses=uses)
    parts = [each for name, each in parts_of(tensors).items() if "value" not in name and "critic" not in name]
    return Recipe("skrl", _checked(tuple(parts), manifest, file), normaliser, uses=uses)


def _checked(parts: tuple[Part, ...], manifest: PolicyManifest, file: str) -> tuple[Part, ...]:
    takes = manifest.network_inputs
    if parts and follows(parts, takes):
        return parts
    check_width(parts, manifest, file)
    raise UsageProblem(
        f"the actor's modules do not follow each other from an observation of {takes} numbers: "
        f"{_described({each.name: each for each in parts})}; give the manifest of this network's observation, "
        "or name its modules in order with --architecture"
    )


def _described(parts: Mapping[str, Part]) -> str:
    return ", ".join(f"{name} ({each.kind} {each.takes}->{each.gives})" for name, each in parts.items()) or "none"


LIBRARIES: dict[str, Callable[[State, str | None, PolicyManifest, str], Recipe]] = {
    "rl-games": rl_games,
    "rsl-rl": rsl_rl,
    "skrl": skrl,
}


def library_of(content: State) -> str:
    """Which library wrote a checkpoint, by its keys."""
    model, policy = content.get("model"), content.get("policy")
    if isinstance(model, Mapping) and any(RL_GAMES in name for name in model):
        return "rl-games"
    if isinstance(content.get("model_state_dict"), Mapping) or isinstance(content.get("actor_state_dict"), Mapping):
        return "rsl-rl"
    if isinstance(policy, Mapping):
        return "skrl"
    return "state-dict"
