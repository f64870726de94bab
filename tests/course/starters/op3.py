"""Starter for "Another robot": ROBOTIS OP3, 3.1 kg, legs of 0.22 m; it walks to goals as ours does.

    python 05_evaluate.py --mujoco --noise --episodes 100 --robot tests/course/starters/op3.py

A file for --robot defines ROBOT, WALK and LIMITS. Nothing is trained: stage 5's policy plans steps
for a robot that it has never seen. The numbers are those of robotis_op3/op3.xml in
google-deepmind/mujoco_menagerie. Links that turn together are merged. Head and hanging arms belong to
the torso.
"""

from importlib import import_module

robot_model, walk_engine, env = map(import_module, ("01_robot_model", "02_walk_engine", "03_env"))
Link = robot_model.Link

ROBOT = robot_model.RobotModel(
    # mass, centre of mass, inertia: sums over <inertial>
    torso=Link(1.959, (-0.0097, 0.0, 0.0691), (0.0128, 0.0073, 0.0087)),
    hip=Link(0.191, (-0.0191, 0.0003, -0.0101), (0.00006, 0.00015, 0.00012)),
    thigh=Link(0.115, (0.0006, 0.0, -0.0841), (0.00010, 0.00010, 0.00002)),
    shin=Link(0.040, (0.0, -0.0025, -0.055), (0.00004, 0.00003, 0.00002)),
    foot=Link(0.248, (-0.0147, 0.0031, 0.001), (0.00017, 0.00030, 0.00025)),
    hip_y=0.035,  # pos of hip_yaw
    hip_z=-0.0285,  # of hip_roll
    hip_x=0.0,  # hip_roll and hip_pitch: −0.024 + 0.0241, the axes meet
    thigh_length=0.11015,  # pos of knee
    shin_length=0.110,  # of ank_pitch
    ankle_height=0.0305,  # the foot's boxes: 0.0265 + 0.004
    foot_front=0.0634,  # 0.024 + 0.0635 − 0.0241
    foot_back=0.0636,
    foot_width=0.078,
    foot_outward=0.0125,
    sole_height=0.008,
    torque_limit=(5.0,) * 6,  # forcerange
    damping=(1.084,) * 6,
    speed_limit=(5 / 1.084,) * 6,
    stiction=(0.03,) * 6,  # frictionloss
    armature=0.045,
    stiffness=150.0,  # our choice: with the file's 21.1 a joint is 51 ms late
    joint_min=(-1.57, -1.57, -2.0, -0.1, -1.4, -1.2),  # our choice: the file has no limits
    joint_max=(1.57, 1.57, 1.5, 2.4, 1.4, 1.2),
)
# We began with our walk of stage 2, scaled to legs of 0.65 times the length (lengths · 0.65, time ·
# √0.65), and with lower and narrower steps, because the rotors are heavy for so small a robot. Then
# walk.py searched twice, each time with 65 candidates of 64 plans, the second time from the first
# result on, in a few minutes each (step_ticks stayed).
WALK = walk_engine.WalkParameters(
    step_ticks=26,
    double_support=0.0363,
    foot_distance=0.099,
    foot_rise=0.014,
    trunk_height=0.2379,
    trunk_phase=-0.1101,
    trunk_pitch=0.0427,
    trunk_swing=0.2617,
    trunk_x_offset=-0.0051,
    trunk_roll=0.0495,
)
# Those of stage 3, times 0.65 (the legs' lengths) and 0.75; yaw times 0.75; less inward. With 0.8
# the robot falls in 2 of 300 walks.
LIMITS = env.StepLimits(low=(-0.058, -0.010, -0.22), high=(0.068, 0.087, 0.37))
