"""Every number of the TriFinger Pro, its arena, cube and cameras, with unit and source.

Sources, as cited beside the numbers:
    RPF   open-dynamic-robot-initiative/robot_properties_fingers @a1dfd63 (URDF of the Pro)
    RF    open-dynamic-robot-initiative/robot_fingers @90b0a31 (configuration and driver of the real robot)
    TS    open-dynamic-robot-initiative/trifinger_simulation @53b413f
    TOT   open-dynamic-robot-initiative/trifinger_object_tracking @78ec981
    TRD   rr-learning/trifinger_rl_datasets @f23729f
    IGE   isaac-sim/IsaacGymEnvs @aeed298
    MEAS  measured on the public meshes and models

A test compares these numbers with the compiled model and the model with the public URDF.
"""

from dataclasses import dataclass

import numpy as np

FINGER_NAMES = ("finger0", "finger120", "finger240")
JOINT_SUFFIXES = ("base_to_upper", "upper_to_middle", "middle_to_lower")
JOINT_NAMES = tuple(f"{finger}_{joint}" for finger in FINGER_NAMES for joint in JOINT_SUFFIXES)
"""Order of all joint vectors, shape (9,): finger0, finger120, finger240, each from base to tip (RF doc/joint_order.rst)."""

# --- kinematics and bodies of one finger (RPF xacro_files/pro/fingerpro_macro.xacro) ---------------------------------

FINGER_BASE_HEIGHT_M = 0.29
FINGER_YAW_RAD = tuple(np.deg2rad([0.0, -120.0, -240.0]))


@dataclass(frozen=True)
class Link:
    """A rigid link: where its frame sits in its parent's, and its mass properties in its own frame."""

    name: str
    origin_m: tuple[float, float, float]
    mass_kg: float
    centre_of_mass_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float, float, float, float]  # ixx, iyy, izz, ixy, ixz, iyz about the centre of mass
    joint_axis: tuple[float, float, float] | None


LINKS = (
    Link(
        name="upper",
        origin_m=(0.0, 0.0, 0.0),
        mass_kg=0.26689,
        centre_of_mass_m=(0.006, 0.122, 0.0),
        inertia_kg_m2=(0.00102362, 0.0000645, 0.00102225, 0.00000889, -0.00000019, 0.00000106),
        joint_axis=(0.0, 1.0, 0.0),
    ),
    Link(
        name="middle",
        origin_m=(0.01685, 0.0505, 0.0),
        mass_kg=0.27163,
        centre_of_mass_m=(0.03935008, -0.00012438, -0.08666705),
        inertia_kg_m2=(0.0009406, 0.00094824, 0.00007573, -0.00000046, -0.00003479, 0.00000164),
        joint_axis=(1.0, 0.0, 0.0),
    ),
    Link(
        name="lower",
        origin_m=(0.05015, 0.0, -0.16),
        mass_kg=0.05569,
        centre_of_mass_m=(0.016327, -0.00001095, -0.04284052),
        inertia_kg_m2=(0.00013626, 0.00013372, 0.00000667, 0.0, -0.00000662, 0.00000004),
        joint_axis=(1.0, 0.0, 0.0),
    ),
    Link(
        name="tip",
        origin_m=(0.019, 0.0, -0.16),
        mass_kg=0.0092,
        centre_of_mass_m=(-0.00001194, 0.0, 0.0156006),
        inertia_kg_m2=(0.00000155, 0.00000155, 0.00000032, 0.0, 0.0, 0.0),
        joint_axis=None,
    ),
)

TIP_RADIUS_M = 0.010  # MEAS meshes/pro/tip_sim.stl: the lower half is a sphere about the tip frame
TIP_STEM_RADIUS_M = 0.0085  # MEAS same mesh: stem of at most 9.94 mm above the sphere; the link tapers
MIDDLE_CAPSULE_RADIUS_M = 0.016  # MEAS meshes/pro/int_sim.stl, fitted by eye to the mesh's cross-section
MIDDLE_CAPSULE_X_M = 0.040  # MEAS same mesh: the tube runs beside the joint axis, through the centre of mass

SOFT_LIMIT_LOWER_RAD = np.tile([-0.33, 0.0, -2.7], 3)  # RPF; RF config/trifingerpro.yml
SOFT_LIMIT_UPPER_RAD = np.tile([1.0, 1.57, 0.0], 3)
"""Soft limits of the driver and, as in the URDF, the range of the model's joints."""
START_JOINT_POSITION_RAD = np.tile([0.0, 0.9, -1.7], 3)  # RF config/trifingerpro.yml

# --- motors and safety (RF config/trifingerpro.yml, include/robot_fingers/trifinger_driver.hpp) ----------------------

TORQUE_CONSTANT_NM_A = 0.02
GEAR_RATIO = 9.0
MAX_CURRENT_A = 2.2
MAX_TORQUE_NM = TORQUE_CONSTANT_NM_A * GEAR_RATIO * MAX_CURRENT_A  # 0.396 N m
SAFETY_DAMPING_NM_S_RAD = np.tile([0.09, 0.09, 0.05], 3)  # the real robot's; TS simulates (0.08, 0.08, 0.04)
POSITION_GAIN_NM_RAD = np.tile([9.0, 9.0, 9.0], 3)
VELOCITY_GAIN_NM_S_RAD = np.tile([0.01, 0.01, 0.01], 3)
TIP_SENSOR_SATURATION_N = 5.0  # TS sim_finger.py: the push sensor in a tip shows 1 "somewhere around 5 N"
TIP_SENSOR_AT_REST = 0.05  # TS same file: what it shows when nothing is touched
SIMULATED_ROBOT_ID = 0  # TRD sim_env.py; real robots have others

# --- rates ------------------------------------------------------------------------------------------------------------

PHYSICS_STEP_S = 0.001  # RF scripts/trifinger_backend.py: control loop of 1 kHz
CAMERA_PERIOD_S = 0.1  # TOT tricamera_object_tracking_driver.hpp: 10 Hz
CAMERA_DELAY_S = 0.090  # TS trifinger_platform.py camera_delay_steps, "based on real robot data"
GRAVITY_M_S2 = 9.81

# --- arena (TS; MEAS meshes/object_containment_sim.stl) ---------------------------------------------------------------

TABLE_HALF_EXTENT_M = (0.38, 0.38, 0.005)  # TS sim_finger.py, top at z = 0
WALL_PROFILE_M = ((0.1948, 0.0), (0.1948, 0.020), (0.278, 0.174))  # MEAS inner radius, height: a ring, then a cone
WALL_SEGMENTS = 24  # boxes around the ring: circular to 1.7 mm
WALL_THICKNESS_M = 0.006  # MEAS 5 to 6 mm

# --- cube v2 (TS cube_v2.urdf; TOT cube_model.hpp) --------------------------------------------------------------------

CUBE_WIDTH_M = 0.065
TRACKED_CUBE_WIDTH_M = 0.0652  # TOT cube_model.hpp: the real cube as its tracker knows it
CUBE_MASS_KG = 0.094
CUBE_INERTIA_KG_M2 = 6.619e-5  # on each axis
CUBE_FACE_COLOURS = {
    "+x": (0.85, 0.10, 0.10),  # red
    "-x": (0.80, 0.10, 0.75),  # magenta
    "+y": (0.10, 0.65, 0.15),  # green
    "-y": (0.95, 0.85, 0.10),  # yellow
    "+z": (0.10, 0.20, 0.85),  # blue
    "-z": (0.10, 0.80, 0.85),  # cyan
}

# --- contact ----------------------------------------------------------------------------------------------------------

CUBE_FRICTION = 1.0
"""Of the cube against fingers, table and wall. No measured value was found; TS and the released Isaac environment (IGE) agree
on 1.0, and both published experts behave as reported with it (docs/decisions/0002-contact-and-limits.md)."""
FINGER_FRICTION = 0.55
"""Of fingers against table, wall and each other: IGE gives the robot 1.0 and the table 0.1, and its physics engine averages."""
TABLE_FRICTION = 0.1  # IGE; MuJoCo takes the larger of two frictions, so that the finger's or the cube's counts

# --- tasks (TS tasks/move_cube; TRD) ----------------------------------------------------------------------------------

ARENA_RADIUS_M = 0.195
CUBE_RADIUS_M = CUBE_WIDTH_M * 3**0.5 / 2  # of the sphere around the cube
MAX_CUBE_CENTRE_DISTANCE_M = ARENA_RADIUS_M - CUBE_RADIUS_M  # 0.1387 m
CUBE_REST_HEIGHT_M = CUBE_WIDTH_M / 2
MAX_GOAL_HEIGHT_M = 0.1
CHALLENGE_XY_RANGE_M = 0.39  # TS move_cube: scales of the 2020 cost
CHALLENGE_Z_RANGE_M = 0.1
KEYPOINT_KERNEL_PER_M = 30.0  # TRD reward: 1 / (e^(30 d) + 2 + e^(-30 d))


@dataclass(frozen=True)
class Camera:
    """A calibrated pinhole camera (TS data/camera_params, 540 x 540 pixels); distortion as k1, k2, p1, p2, k3."""

    name: str
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    position_world_m: tuple[float, float, float]
    optical_axis_world: tuple[float, float, float]


CAMERA_RESOLUTION_PX = (540, 540)
CAMERAS = (
    Camera(
        name="camera60",
        focal_px=(587.298, 591.540),
        centre_px=(291.286, 277.456),
        distortion=(-0.23805, 0.10826, -0.00246, 0.00005, -0.02723),
        position_world_m=(0.250, 0.246, 0.389),
        optical_axis_world=(-0.471, -0.469, -0.747),
    ),
    Camera(
        name="camera180",
        focal_px=(585.064, 587.965),
        centre_px=(281.135, 278.415),
        distortion=(-0.23739, 0.14669, -0.00336, 0.00022, -0.13565),
        position_world_m=(-0.002, -0.267, 0.462),
        optical_axis_world=(0.0, 0.510, -0.860),
    ),
    Camera(
        name="camera300",
        focal_px=(586.437, 590.807),
        centre_px=(288.080, 284.183),
        distortion=(-0.23391, 0.09394, -0.00279, -0.00007, -0.01742),
        position_world_m=(-0.250, 0.247, 0.389),
        optical_axis_world=(0.470, -0.463, -0.751),
    ),
)

CAMERA_POSES = (
    (
        (-0.7019134208048192, 0.7122353932236418, -0.004805374269147043, 0.002252555442149284),
        (0.5344638657119378, 0.5222316464208596, -0.6645386970157846, -0.0032747731308788697),
        (-0.47079826418692317, -0.46902151242952833, -0.7472317485480533, 0.5238875639497548),
    ),
    (
        (0.9999898148320592, 0.0011975322534177515, 0.0009296176718924966, 0.0015825167118240365),
        (0.0015046826000956175, -0.8603974609595656, -0.5096079454902745, 0.005907939842208572),
        (0.00019394945000544882, 0.5096062743319824, -0.8603966378529374, 0.5336501221993086),
    ),
    (
        (-0.7133771728609642, -0.7006191670792009, -0.01456422308851129, 0.000684373876406266),
        (-0.5196240895754424, 0.5428037431338101, -0.6598003871028696, -0.007554524367671664),
        (0.4701789145919274, -0.463122803047164, -0.751291777787446, 0.5244100800677238),
    ),
)
"""``tf_world_to_camera`` of each camera as its file has it, 3 x 4: rotation, then translation in m; the camera looks along +z
with x to the right and y down (TS data/camera_params/camera*_cropped.yml). ``CAMERAS`` holds the same, rounded: every figure of
the formula was made with those numbers."""
CAMERA_LENSES = (
    (
        (293.6491860743451, 295.7697633410819, 145.6428952811477, 138.72778249344682),
        (-0.23804660749779824, 0.10825771776560758, -0.0024551017209611128, 4.8257038130254314e-05, -0.02722946246691342),
    ),
    (
        (292.5321793738852, 293.9826924571245, 140.56754510529728, 139.20755458502873),
        (-0.23738566123860577, 0.14668759366047324, -0.0033595184065924786, 0.0002152185045991212, -0.13564647032376007),
    ),
    (
        (293.2185828220331, 295.4036653836364, 144.0399813517686, 142.0913683807789),
        (-0.23391341982227962, 0.09394432535010212, -0.002787865901636738, -7.252943212413023e-05, -0.017420413881185703),
    ),
)
"""Focal lengths and centre (fx, fy, cx, cy) in pixels of the tracker's images, and distortion (k1, k2, p1, p2, k3), as
TS data/camera_params/camera*_cropped_and_downsampled.yml has them."""
CAMERA_IMAGE_PX = 270  # width and height of the tracker's images (same files)
