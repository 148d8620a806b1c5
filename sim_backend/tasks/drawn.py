"""What seeds stand for, as JSON: ``python -m sim_backend.tasks.drawn TASK SEED...``; services ask it, which load no physics."""

import json
import sys

from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_trial

DIGITS = 5
"""Of a metre; seeds give the rest."""


def main(arguments: list[str]) -> int:
    """Print a list with start and goal of each seed."""
    task = TASKS[arguments[0]]
    found = []
    for seed in map(int, arguments[1:]):
        start, goal = draw_trial(task, seed)
        pose = (goal.cube_position_world_m, goal.cube_quat_wxyz) if task.moves_cube else (None, None)
        tips = None if task.moves_cube else goal.fingertip_position_world_m
        values = (*pose, tips, start.cube_position_world_m, start.cube_quat_wxyz)
        found.append([None if value is None else value[0].round(DIGITS).tolist() for value in values])
    print(json.dumps(found, separators=(",", ":")))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
