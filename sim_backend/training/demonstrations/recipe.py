"""Recipes of policies that imitate: by cloning of recordings, or by DAgger from a teacher that says what it would have done."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from api_schemas.policy import LAYOUTS, PolicyManifest
from api_schemas.policy_network import Cell
from sim_backend.environments.action_space import ActionMode
from sim_backend.layouts import layout_of
from sim_backend.tasks import TASKS
from sim_backend.training.recipe import Count, EvaluationTable, Layers, Positive, RecipeFile, Table, WarmStartTable

IMITATIONS = ("cloning", "dagger")
"""What ``method`` of a recipe may be for the recipe to be one of these."""


class TeacherTable(Table):
    """Who shows how.

    ``policy`` is a safetensors file or the name of a shipped reference policy, ``layout`` what it expects if no manifest lies
    beside it. With the view ``truth`` it sees the cube and the joints as they are, without delay, noise and offsets; with
    ``robot`` what its manifest's robot would show it.
    """

    policy: str
    layout: str | None = None
    view: Literal["robot", "truth"] = "robot"
    acts_until: Annotated[float, Field(ge=0, le=1)] = 0.2  # share of the run in which its share of the trials falls from 1 to 0


class StudentTable(Table):
    """Hidden layers, ELU between them; with ``cell`` so many ``cells`` before them."""

    hidden: Layers = (256, 256)
    cell: Cell | None = None
    cells: Annotated[int, Field(ge=1, le=1024)] = 128


class ImitationTable(Table):
    """Settings of the learning; a window is so many control periods of all robots, with updates after each."""

    robots: Count = 128
    window: Count = 30
    updates: Count = 12
    batch: Count = 1024  # samples of an update; whole windows of some robots where the student has cells
    learning_rate: Positive = 1e-3
    final_learning_rate: Positive = 1e-5
    largest_gradient: Positive = 1.0
    largest_memory: Count = 1_000_000  # samples; the oldest give way
    least_memory: Count = 20_000  # samples before the first update, also after --resume
    freeze_inputs_after: Count = 100_000  # samples


class ImitationRecipe(RecipeFile):
    """Everything about a run of cloning or DAgger."""

    method: Literal["cloning", "dagger"]
    about: str = ""
    task: str
    layout: str
    action: ActionMode = ActionMode.TORQUE
    physics: str = "real"
    episode_s: Positive | None = None
    physics_step_s: Positive = 0.004
    samples: Count
    minutes: Positive | None = None  # ends then, if that comes first
    seed: Annotated[int, Field(ge=0)] = 1
    checkpoint_minutes: Positive = 5.0
    teacher: TeacherTable | None = None
    demonstrations: tuple[str, ...] = ()
    warm_start: WarmStartTable | None = None
    student: StudentTable = StudentTable()
    imitation: ImitationTable = ImitationTable()
    evaluation: EvaluationTable = EvaluationTable(every_samples=1_000_000)

    @model_validator(mode="after")
    def _names_exist(self) -> "ImitationRecipe":
        if self.task not in TASKS:
            raise ValueError(f"unknown task {self.task!r}; choose from {', '.join(TASKS)}")
        for layout in (self.layout, *((self.teacher.layout,) if self.teacher and self.teacher.layout else ())):
            if layout not in LAYOUTS:
                raise ValueError(f"unknown layout {layout!r}; choose from {', '.join(LAYOUTS)}")
        return self

    @model_validator(mode="after")
    def _there_is_something_to_imitate(self) -> "ImitationRecipe":
        if self.action is ActionMode.BINS:
            raise ValueError("bins are not imitated; choose an action of numbers")
        if self.warm_start is not None and self.student.cell is not None:
            raise ValueError("a [warm_start] has no cells; leave it or student.cell out")
        if self.method == "dagger" and (self.teacher is None or self.demonstrations):
            raise ValueError("dagger needs a [teacher] and no demonstrations: it makes its own")
        if self.method == "cloning" and (self.teacher is not None or not self.demonstrations):
            raise ValueError("cloning needs demonstrations = [files] and no [teacher]; record them first")
        return self

    @property
    def manifest(self) -> PolicyManifest:
        """The layout that is seen, before the action space is added."""
        return layout_of(self.layout)
