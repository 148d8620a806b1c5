"""A recipe: the small TOML file that says everything about a training run."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from api_schemas.policy import LAYOUTS, PolicyManifest
from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.environments.action_space import ActionMode
from sim_backend.layouts import layout_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.reward import Reward, RewardKind

if TYPE_CHECKING:
    from sim_backend.training.demonstrations.recipe import ImitationRecipe

RECIPES = Path(__file__).parent / "recipes"
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Layers = Annotated[tuple[Count, ...], Field(min_length=1, max_length=8)]


class RecipeError(ValueError):
    """There is no such recipe, or it does not hold; the message says what to change."""


class Table(BaseModel):
    """A table of a recipe: unknown entries are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RewardTable(Table):
    """Weights of the reward (``tasks/reward.py``)."""

    kind: RewardKind = RewardKind.KEYPOINT_KERNEL
    goal: float = Reward.goal
    approach: float = Reward.approach
    joint_speed: float = Reward.joint_speed
    scale: Positive = Reward.scale
    kernel_per_m: Positive = Reward.kernel_per_m
    fine_kernel_per_m: Positive | None = Reward.fine_kernel_per_m


class Networks(Table):
    """Hidden layers of actor and critic, ELU between them.

    With ``privileged`` the critic knows what only a simulation knows. With ``memory`` an LSTM of so many cells comes before the
    layers, in the actor and in the critic.
    """

    actor: Layers = (128, 128)
    critic: Layers = (256, 128)
    privileged: bool = False
    memory: Annotated[int, Field(ge=1, le=1024)] | None = None

    @model_validator(mode="after")
    def _fit_together(self) -> "Networks":
        if self.privileged and self.memory:
            raise ValueError("privileged and memory do not go together: the memory's inputs would be those of the critic, too")
        return self


class Ppo(Table):
    """Settings of PPO; the defaults are those that worked for push (docs/learning.md)."""

    robots: Count = 1024
    steps: Count = 16
    epochs: Count = 4
    minibatch: Count = 4096
    learning_rate: Positive = 5e-4
    final_learning_rate: Positive | None = None  # reached linearly at the end; constant if left out
    discount: Annotated[float, Field(gt=0, lt=1)] = 0.99
    gae_lambda: Annotated[float, Field(gt=0, le=1)] = 0.95
    clip: Positive = 0.2
    entropy: Annotated[float, Field(ge=0)] = 0.0
    value: Positive = 0.5
    largest_gradient: Positive = 1.0
    first_deviation: Positive = 0.5  # of the actions, in units of the largest
    slices: Count = 8  # of the robots, with seeds of their own, where workers roll them out; the same for any number of workers
    lag: Annotated[int, Field(ge=0, le=1)] = 0  # updates by which rollouts of workers are behind; 1: they go on meanwhile
    freeze_inputs_after: Count = 200  # iterations; the scaling of the inputs stays as it is from then on


class Randomization(Table):
    """How the robots practised with change while training: ``none`` draws from the whole of ``physics`` from the begin."""

    method: Literal["none", "adr"] = "none"
    low: float = 0.5  # success rate at a boundary below which it moves in,
    high: float = 0.8  # and above which it moves out
    trials: Count = 64  # at a boundary, for each decision
    step: Annotated[float, Field(gt=0, le=1)] = 0.1  # share of the whole range by which a boundary moves
    at_boundary: Annotated[float, Field(ge=0, lt=1)] = 0.5  # share of the trials that are spent at a boundary


class Level(Table):
    """A level of a curriculum: the task that is practised until its success rate is reached."""

    task: str
    until: Annotated[float, Field(gt=0, le=1)] = 0.8


class DemonstrationTable(Table):
    """DAPG: the actor begins as a clone of demonstrations, and a term of PPO's loss holds it there, ever less.

    After so many ``clone_updates`` the critic learns alone for ``critic_first`` iterations. The term counts ``weight`` times
    ``decay`` to the power of the iterations since, and never less than ``least_weight``.
    """

    files: Annotated[tuple[str, ...], Field(min_length=1)]
    clone_updates: Annotated[int, Field(ge=0)] = 3000
    batch: Count = 1024
    critic_first: Annotated[int, Field(ge=0)] = 20
    weight: Annotated[float, Field(ge=0)] = 1.0
    decay: Annotated[float, Field(gt=0, le=1)] = 0.99
    least_weight: Annotated[float, Field(ge=0)] = 0.0


class ResidualTable(Table):
    """The policy that stays as it is, and what a residual of 1 is, as a share of the largest action."""

    policy: str
    layout: str | None = None
    share: Positive = 0.1


class WarmStartTable(Table):
    """A policy of plain layers that the one to be trained begins as."""

    policy: str
    layout: str | None = None


class PpoWarmStartTable(Table):
    """What PPO begins with: a policy of plain layers, or all that another run of PPO has learned (``run`` is its folder).

    A policy comes without a critic. The new one learns alone for the first iterations, at a rate of its own: a critic that does
    not know yet what a step is worth leads a good actor astray (docs/learning.md). A run's critic is taken over instead.
    """

    policy: str | None = None
    layout: str | None = None
    run: str | None = None
    critic_first: Annotated[int, Field(ge=0)] = 120
    critic_learning_rate: Positive = 1e-3

    @model_validator(mode="after")
    def _one_of_both(self) -> "PpoWarmStartTable":
        if (self.policy is None) == (self.run is None):
            raise ValueError("a [warm_start] names a policy or the folder of a run")
        if self.run is not None and self.model_fields_set != {"run"}:
            raise ValueError("with warm_start.run the rest of [warm_start] has no meaning; leave it out")
        return self


class EvaluationTable(Table):
    """When and how the policy is tried while training: on robots of each of the ``physics``, with steps of 4 ms."""

    every_samples: Count = 2_000_000
    trials: Count = 64
    physics: tuple[str, ...] = ("nominal", "real")
    final_trials: Annotated[int, Field(ge=0)] = 200  # at the end, at 1 kHz


class RecipeFile(Table):
    """What every recipe has: the robots practised with, whose ranges may lie beside its file."""

    physics: str
    nominal_share: Annotated[float, Field(ge=0, le=1)] = 0.0  # of the trials, on nominal robots instead
    _folder: Path | None = PrivateAttr(default=None)  # of the recipe's file; no part of what is trained

    @property
    def physics_source(self) -> str:
        """Name of the preset, or path of the file, which is looked for beside the recipe first."""
        beside = None if self._folder is None else self._folder / self.physics
        return str(beside) if beside is not None and beside.is_file() else self.physics


class Recipe(RecipeFile):
    """Everything about a run of PPO, from scratch or from demonstrations or from another policy."""

    method: Literal["ppo", "dapg", "residual"] = "ppo"
    about: str = ""
    task: str
    layout: str
    action: ActionMode = ActionMode.TORQUE
    action_scale: Positive | None = None
    physics: str = "nominal"
    episode_s: Positive | None = None
    physics_step_s: Positive = 0.004
    physics_backend: PhysicsBackend = PhysicsBackend.CPU  # "warp" for a GPU; evaluations are MuJoCo's own all the same
    samples: Count
    minutes: Positive | None = None  # ends then, if that comes first
    seed: Annotated[int, Field(ge=0)] = 1
    checkpoint_minutes: Positive = 5.0
    reward: RewardTable = RewardTable()
    networks: Networks = Networks()
    ppo: Ppo = Ppo()
    randomization: Randomization = Randomization()
    curriculum: tuple[Level, ...] = ()
    evaluation: EvaluationTable = EvaluationTable()
    demonstrations: DemonstrationTable | None = None
    residual: ResidualTable | None = None
    warm_start: PpoWarmStartTable | None = None

    @model_validator(mode="after")
    def _method_has_its_table(self) -> "Recipe":
        for method, table, there in (
            ("dapg", "demonstrations", self.demonstrations),
            ("residual", "residual", self.residual),
        ):
            if (self.method == method) != (there is not None):
                raise ValueError(f"method is {self.method!r}; [{table}] belongs to the method {method!r}, which needs it")
        if self.method != "ppo" and self.networks.memory is not None:
            raise ValueError(f"method {self.method!r} does not go with a memory; leave networks.memory out")
        if self.randomization.method == "adr" and self.nominal_share:
            raise ValueError("ADR begins with nominal robots by itself; leave nominal_share out")
        if self.warm_start is not None and (self.method != "ppo" or self.networks.memory is not None):
            raise ValueError("a [warm_start] goes with PPO without a memory only; leave it or the other out")
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> "Recipe":
        for task in (self.task, *(level.task for level in self.curriculum)):
            if task not in TASKS:
                raise ValueError(f"unknown task {task!r}; choose from {', '.join(TASKS)}")
        if self.layout not in LAYOUTS:
            raise ValueError(f"unknown layout {self.layout!r}; choose from {', '.join(LAYOUTS)}")
        batch = self.ppo.robots * self.ppo.steps
        if batch % self.ppo.minibatch:
            raise ValueError(f"minibatch is {self.ppo.minibatch}; it must divide robots times steps, {batch}")
        return self

    @property
    def manifest(self) -> PolicyManifest:
        """The layout that is seen, before the action space is added."""
        return layout_of(self.layout)


def shipped_recipes() -> list[str]:
    """Names of the recipes that come with the project."""
    return sorted(path.stem for path in RECIPES.glob("*.toml"))


def load_recipe(name_or_path: str) -> tuple[str, "Recipe | ImitationRecipe"]:
    """A recipe and its name: one that is shipped, or a TOML file.

    Raises:
        RecipeError: it is not there or does not hold.
    """
    path = RECIPES / f"{name_or_path}.toml" if name_or_path in shipped_recipes() else Path(name_or_path)
    if not path.is_file():
        raise RecipeError(f"no recipe {name_or_path!r}; choose from {', '.join(shipped_recipes())}, or name a TOML file")
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        recipe = schema_of(document).model_validate(document)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RecipeError(f"{path} is not a TOML file: {error}") from error
    except ValidationError as error:
        reasons = "; ".join(f"{'.'.join(map(str, each['loc'])) or 'recipe'}: {each['msg']}" for each in error.errors())
        raise RecipeError(f"{path}: {reasons}") from error
    recipe._folder = path.parent
    return path.stem, recipe


def schema_of(document: dict) -> "type[Recipe] | type[ImitationRecipe]":
    """Of which kind a recipe is, by its ``method``."""
    from sim_backend.training.demonstrations.recipe import IMITATIONS, ImitationRecipe

    return ImitationRecipe if document.get("method") in IMITATIONS else Recipe
