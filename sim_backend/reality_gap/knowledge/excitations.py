"""Which motion shows which effect.

The orders follow from a simulation (2026-11-21): each effect was given to one joint at a size near its detection limit. First
comes the excitation in which what it changes in measured positions, velocities and torques is largest beside what others change.
"""

SHOWN_BY: dict[str, tuple[str, ...]] = {
    "action_delay": ("chirps", "oscillations", "fast_sweeps"),
    "timing_jitter": ("oscillations", "fast_sweeps", "chirps"),
    "torque_constant": ("fast_sweeps", "oscillations", "chirps"),
    "torque_saturation": ("fast_sweeps", "joint_limits", "hold_poses"),
    "supply_sag": ("oscillations", "joint_limits", "fast_sweeps"),
    "thermal_derating": ("hold_poses", "chirps", "slow_ramps"),
    "cogging": ("joint_limits", "slow_ramps", "hold_poses"),
    "action_noise": ("hold_poses", "slow_ramps"),
    "backlash": ("joint_limits", "chirps", "oscillations"),
    "position_gain": ("joint_limits", "chirps", "hold_poses"),
    "safety_damping": ("fast_sweeps", "oscillations", "chirps"),
    "coulomb_friction": ("fast_sweeps", "slow_ramps", "chirps"),
    "viscous_friction": ("fast_sweeps", "oscillations"),
    "stribeck_friction": ("slow_ramps", "joint_limits", "hold_poses"),
    "load_friction": ("fast_sweeps", "oscillations", "chirps"),
    "directional_friction": ("fast_sweeps", "chirps", "joint_limits"),
    "stuck_joint": ("joint_limits", "fast_sweeps"),
    "link_mass": ("fast_sweeps", "oscillations", "chirps"),
    "rotor_inertia": ("chirps", "joint_limits", "oscillations"),
    "joint_stiffness": ("fast_sweeps", "joint_limits", "oscillations"),
    "joint_limits": ("joint_limits",),
    "table_tilt": ("joint_limits", "fast_sweeps", "slide_cube"),
    "gravity": ("joint_limits", "fast_sweeps", "oscillations"),
    "encoder_offset": ("joint_limits", "hold_poses"),
    "encoder_quantisation": ("slow_ramps", "hold_poses"),
    "velocity_filter": ("chirps", "oscillations", "fast_sweeps"),
    "joint_noise": ("hold_poses",),
    "joint_episode_noise": ("joint_limits", "hold_poses"),
    "encoder_jump": ("joint_limits", "fast_sweeps"),
    "controller_restart": ("fast_sweeps", "oscillations"),
    "fingertip_friction": ("slide_cube",),
    "table_friction": ("slide_cube",),
    "cube_mass": ("slide_cube",),
    "cube_size": ("slide_cube",),
    "contact_stiffness": ("slide_cube",),
    "cube_pushes": ("hold_poses",),
    "tracking_rate": ("slide_cube",),
    "tracking_latency": ("slide_cube",),
    "tracking_jitter": ("slide_cube",),
    "tracking_dropout": ("slide_cube", "hold_poses"),
    "tracking_scale": ("slide_cube",),
    "tracking_offset": ("slide_cube", "hold_poses"),
    "tracking_noise": ("hold_poses", "slide_cube"),
    "tracking_episode_noise": ("hold_poses",),
    "observation_noise": ("hold_poses",),
    "orientation_jumps": ("hold_poses", "slide_cube"),
    "colour_segmentation": ("hold_poses", "slide_cube"),
    "occlusion_by_fingers": ("slide_cube", "oscillations"),
    "foreign_occlusion": ("slide_cube",),
    "dead_camera": ("slide_cube", "hold_poses"),
}
"""Excitations in which an effect shows, the best first."""

BY_HAND: dict[str, str] = {
    "finger_table_friction": "press a fingertip on the table and draw it along: no excitation touches the table",
    "fingertip_friction": "lift the cube with a policy (trifarm submit --task lift): a grip shows how much the tips hold",
    "cube_mass": "weigh the cube, or lift it: pushing shows mass and friction as a product",
    "cube_size": "measure the cube with a caliper",
    "tracking_scale": "let the cameras see a known distance, or record tosses: free flight must fall with 9.81 m/s²",
    "torque_constant": "hang a known mass on the finger: from motion alone, torque constants and masses scale together",
    "joint_limits": "lead the joint to its end by hand and read its encoder there",
    "gravity": "turn the base to another orientation: the sensors' zeros stay, gravity does not",
    "camera_pose": "calibrate the cameras again with a board: images of it show where each stands",
    "camera_lens": "calibrate the cameras again with a board that fills each image up to its corners",
    "lamp": "look at images of a grey card on the table, turned to each side",
    "surroundings": "look at images of the empty arena beside a grey card",
    "face_paint": "look at images of each face beside a grey card in the same light",
    "gloss": "turn a face of the cube under the lamp: a reflection wanders, paint does not",
    "exposure": "look at images of a white card: how bright it is says how much light a camera takes",
    "white_balance": "look at images of a grey card: its red and blue are to be as its green",
    "image_blur": "look at images of a sharp edge at rest",
    "image_noise": "subtract two images of an arena at rest",
    "thermal_derating": "rest until the motors are cold, then record: only the way from cold to warm shows it",
}
"""What nobody can do by running an excitation alone."""

AT_ONCE = ("torque_constant", "cube_mass")
"""Of these: what no motion of any robot tells, so that a new one is asked for it."""

FOLLOWED: dict[str, tuple[str, tuple[str, ...]]] = {
    "load against motion": ("lifting and lowering the same load", ("fast_sweeps", "oscillations")),
    "time since reversal": ("many reversals, slow and quick ones", ("oscillations", "slow_ramps")),
    "acceleration": ("the same way with other accelerations", ("chirps", "fast_sweeps")),
    "velocity": ("slow and fast motion over the same way", ("slow_ramps", "fast_sweeps")),
    "position": ("the whole range, moving and at rest", ("joint_limits", "hold_poses")),
    "torque": ("torques apart from motion, and loads at rest", ("chirps", "hold_poses")),
    "heat": ("loads at rest until the motors are warm, more than once", ("hold_poses", "oscillations")),
    "time": ("the same motion again, to see whether it drifts or comes back", ("hold_poses", "oscillations")),
}
"""By what an unexplained residual follows: the contrast that shows it, and excitations that hold it."""
