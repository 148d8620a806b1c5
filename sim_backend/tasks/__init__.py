"""The tasks of a robot: goals, start poses and scores. ``TASKS`` is all that a robot can do."""

from sim_backend.tasks.move_cube import FLOOR_POSE, LIFT, MOVE_CUBE_LEVELS, PUSH
from sim_backend.tasks.reach import REACH
from sim_backend.tasks.task import Task

TASKS: dict[str, Task] = {task.name: task for task in (PUSH, LIFT, REACH, FLOOR_POSE, *MOVE_CUBE_LEVELS)}
