"""Runs an excitation instead of a policy: the same robot, the same log, no goal."""

import numpy as np

from api_schemas.trial import OutcomeKind
from robot_farm.recorder import Recorder
from robot_farm.run import Failure, Run
from sim_backend.driver.driver import hold_command
from sim_backend.driver.simulated import PhysicsDivergedError
from sim_backend.excitations.course import Sight
from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.trifinger import constants as c


def run_excitation(run: Run, recorder: Recorder) -> tuple[Failure | None, int]:
    """Give one command of the lease's excitation after the other; returns how it failed, or None, and the step it came to."""
    assert run.lease.excitation is not None, "a lease without a policy has an excitation"
    excitation = EXCITATIONS[run.lease.excitation.value]
    driver, tracker, step = run.driver, run.ready.tracker, 0
    driver.reset(run.ready.start)
    recorder.begin(None, run.ready.goal, tracker.reset(driver.measure(), run.ready.start.noise_seed))
    run.progress.duration_s, run.progress.simulated_s = excitation.duration_s, 0.0
    course, command, steps = excitation.course(np.random.default_rng(run.lease.seed)), hold_command(np.zeros((1, 9))), 0
    sight = None
    try:
        while True:
            try:
                command, steps = course.send(sight)  # pyrefly: ignore[bad-argument-type] - the first is None
            except StopIteration:
                return None, step
            run.go_on(step)
            segment = driver.advance([(command, steps)])
            step += steps
            tracker.capture(segment)
            tracked, state = tracker.deliver(step), driver.measure()
            recorder.record_command(command, segment, tracked, run.temperature_rise_k)
            seen = tracker.reading(step)
            sight = Sight(state.joint_position_rad[0], seen.cube_position_world_m[0], seen.cube_quat_wxyz[0])
            wrong = run.after(segment, tracked, state, step * c.PHYSICS_STEP_S)
            if wrong is not None:
                return (OutcomeKind.PLATFORM_ERROR, wrong), step
    except PhysicsDivergedError as error:
        return (OutcomeKind.PLATFORM_ERROR, str(error)), step
