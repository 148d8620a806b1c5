"""Robots that differ while training: with and without, and which groups of differences it takes."""

from experiments.catalogue.recipes import BEFORE_THE_FARM, FINE_REWARD, NOMINAL_RATE, REAL_RATE, SEEDS, START_RATE, from_scratch
from experiments.catalogue.sources import ALLSHIRE, DACTYL
from experiments.design import Cell, Claim, Contrast, Experiment, Farm, FarmTrials, Measure, Start, Training

_START_SAMPLES, _SAMPLES = 4_000_000, 1_200_000
START = Start("push-begun", from_scratch("push", _START_SAMPLES, every=1_000_000, reward=FINE_REWARD), START_RATE)
"""What all runs go on from; it has seen nominal robots only."""
GROUPS: dict[str, tuple[str, ...]] = {
    "joints": (
        "coulomb_friction",
        "viscous_friction",
        "stribeck_friction",
        "load_friction",
        "directional_friction",
        "backlash",
        "torque_constant",
        "thermal_derating",
        "cogging",
        "action_noise",
        "joint_stiffness",
        "rotor_inertia",
        "link_mass",
    ),
    "contacts": (
        "fingertip_friction",
        "table_friction",
        "finger_table_friction",
        "contact_stiffness",
        "cube_mass",
        "cube_size",
        "table_tilt",
    ),
    "delays": ("action_delay", "timing_jitter", "tracking_latency", "tracking_jitter", "velocity_filter"),
    "sensing": (
        "encoder_offset",
        "encoder_quantisation",
        "joint_noise",
        "joint_episode_noise",
        "tracking_dropout",
        "tracking_scale",
        "tracking_offset",
        "tracking_noise",
        "tracking_episode_noise",
        "orientation_jumps",
        "colour_segmentation",
        "occlusion_by_fingers",
    ),
}
"""Every effect of ``real`` in one group."""


def _practised(physics: str, without: tuple[str, ...] = ()) -> Training:
    recipe = from_scratch("push", _SAMPLES, every=_SAMPLES // 4, physics=physics, reward=FINE_REWARD)
    recipe["ppo"] = recipe["ppo"] | {"learning_rate": 3e-4}
    recipe["evaluation"] = recipe["evaluation"] | BEFORE_THE_FARM
    return Training(recipe, NOMINAL_RATE if physics == "nominal" else REAL_RATE, without, start=START)


RANDOMIZATION = Experiment(
    letter="b",
    name="randomization",
    title="Robots that differ while training",
    question="Does training on robots that differ help on robots of a farm that differ, and what does it cost on nominal ones?",
    claims=(
        Claim("without randomisation policies hardly transfer to the physical robot", DACTYL),
        Claim("randomisation and keypoints together give 83 % on the remote real robot", ALLSHIRE),
    ),
    limits="Both cells go on, for 1.2 million samples, from the same 4 million on nominal robots, with actor and critic; "
    "the farm's robots come from the same ranges as the training's (other seeds), which no real laboratory could know.",
    cells=(
        Cell("nominal", "goes on with nominal robots", SEEDS, _practised("nominal")),
        Cell("randomized", "goes on with robots of `real`", SEEDS, _practised("real")),
    ),
    contrasts=(
        Contrast("randomised against not, real robots", Measure.SUCCESS, "nominal", "randomized", 0.1, "real"),
        Contrast("not randomised against randomised, nominal robots", Measure.SUCCESS, "randomized", "nominal", 0.1, "nominal"),
    ),
    trials=FarmTrials("push", farms=(Farm("nominal"), Farm("real")), seed=32_000),
)


def _left_out(group: str) -> Cell:
    about = f"robots of `real`, but for their {group}"
    return Cell(f"without-{group}", about, (1,), _practised("real", GROUPS[group]))


ABLATION = Experiment(
    letter="e",
    name="ablation",
    title="Which differences it takes",
    question="Which groups of randomisations does the transfer need? One at a time is left out while training.",
    claims=(Claim("leaving out groups of randomisations lowers the successes on the physical robot", DACTYL),),
    limits="As in (b), whose runs of seed 1 are two of the cells. One seed a cell: what a contrast says holds for "
    "these policies, and "
    "is no statement about other seeds.",
    cells=(
        Cell("all", "robots of `real`", (1,), runs_of="randomization", runs_of_cell="randomized"),
        *(_left_out(group) for group in GROUPS),
        Cell("none", "nominal robots", (1,), runs_of="randomization", runs_of_cell="nominal"),
    ),
    contrasts=(
        *(Contrast(f"all against all but {group}", Measure.SUCCESS, f"without-{group}", "all", 0.15) for group in GROUPS),
        Contrast("all against none", Measure.SUCCESS, "none", "all", 0.15),
    ),
    trials=FarmTrials("push", seed=35_000, blocks=24, block=5),
)
