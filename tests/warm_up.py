"""``python -m tests.warm_up``: compile what robots and the reality gap need, so that no two tests compile the same at once."""

import sys

from sim_backend import warm_up
from sim_backend.driver import native_control
from sim_backend.reality_gap.subjects.joints.laws import motor_law, play_law
from sim_backend.reality_gap.subjects.joints.rollouts import chain_steps


def main() -> int:
    """Whatever is kept between processes."""
    for compiled in (
        native_control.measurer,
        chain_steps.simulate,
        motor_law.in_simulations,
        motor_law._compiled,
        motor_law._compiled_shape,
        play_law._compiled,
    ):
        compiled()
    return warm_up.main()


if __name__ == "__main__":
    sys.exit(main())
