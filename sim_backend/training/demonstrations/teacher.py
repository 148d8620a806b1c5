"""The policy that shows how: which one it is, what it sees, and what it asks for in units of the student's actions."""

from pathlib import Path

import numpy as np

from api_schemas.policy import PolicyManifest
from sim_backend.environments.environment import Environment
from sim_backend.layouts import layout_of
from sim_backend.observation import ObservationBuilder, Sight
from sim_backend.training import reference_policies
from sim_backend.training.demonstrations.recipe import TeacherTable
from sim_backend.training.export import ExportedPolicy, read_policy


class Teacher:
    """A policy that watches robots which another one may drive. Owner of its memory of their trials.

    Args:
        policy: who shows how.
        environment: the robots.
        truth: whether it sees cube and joints as they are, instead of what robots report.

    Raises:
        ValueError: its actions are of another kind or come at another rate than those of the robots.
    """

    def __init__(self, policy: ExportedPolicy, environment: Environment, *, truth: bool = False) -> None:
        check_same_actions(policy.manifest, environment.practice.manifest)
        self._policy, self._environment, self._truth = policy, environment, truth
        self._builder = ObservationBuilder(policy.manifest.observation)
        policy.begin(environment.robots)

    def outputs(self) -> np.ndarray:
        """What it would do now, shape (n, 9), in [-1, 1] as the robots' action space has it."""
        sight = self._environment.sight()
        seen = self._builder.build(as_it_is(sight) if self._truth else sight)
        action, space = self._policy(np.nan_to_num(seen).astype(np.float32)), self._environment.practice.action_space
        return np.clip((action - space.middle) / space.largest, -1.0, 1.0)

    def forget(self, robots: np.ndarray) -> None:
        """These robots begin new trials."""
        self._policy.forget(robots)


def as_it_is(sight: Sight) -> Sight:
    """The same instant without delay, noise and offsets of tracker and encoders: what only a simulation knows."""
    measured = sight.measurement
    joints = {
        "joint_position_rad": measured.true_joint_position_rad,
        "joint_velocity_rad_s": measured.true_joint_velocity_rad_s,
    }
    cube = {
        "cube_position_world_m": measured.cube_position_world_m,
        "cube_quat_wxyz": measured.cube_quat_wxyz,
        "capture_step": np.asarray(sight.step),
    }
    return sight._replace(measurement=measured._replace(**joints), tracked=sight.tracked._replace(**cube))


def check_same_actions(first: PolicyManifest, second: PolicyManifest) -> None:
    """Raises ValueError if one policy's actions could not stand for the other's."""
    if first.action_kind is not second.action_kind or first.rate_hz != second.rate_hz:
        raise ValueError(
            f"{first.name} gives {first.action_kind.value} at {first.rate_hz} Hz, the recipe {second.action_kind.value} at "
            f"{second.rate_hz} Hz; choose a recipe with the same"
        )


def find_policy(name_or_path: str, layout: str | None = None) -> ExportedPolicy:
    """A shipped reference policy by its name, or a safetensors file.

    Raises:
        ValueError: there is none, or it has no manifest.
    """
    shipped = reference_policies.folder() / f"{name_or_path}.safetensors"
    path = shipped if shipped.is_file() else Path(name_or_path)
    if not path.is_file():
        names = ", ".join(reference_policies.names())
        raise ValueError(f"there is no policy {name_or_path!r}; choose from {names}, or name a safetensors file")
    return read_policy(path, layout_of(layout) if layout else None)


def read_teacher(table: TeacherTable, environment: Environment) -> Teacher:
    """The teacher of a recipe."""
    policy = find_policy(table.policy, table.layout)
    return Teacher(policy, environment, truth=table.view == "truth")
