"""The one list of the exercises in which a function is to be written: sheet.py empties it,
grading.py grades it, ../repository/test_workbook.py checks that exercises.md agrees.
"""

import sys
from collections import namedtuple

Exercise = namedtuple(
    "Exercise",
    (
        "name",  # what `--only` and `-k` call it
        "file",  # its module: a stage, or one in this folder or in ../studies
        "functions",  # what is to be written; a method with its class
        "stars",  # 1: follow the formula … 4: an algorithm
        "minutes",
        "tests",  # the module that grades it, and how the names of the tests begin
        "since",  # "": all of the body; else from the statement on that begins like this
    ),
    defaults=("",),
)

ROBOT = "01_robot_model"
ENGINE = "02_walk_engine"
ENV = "03_env"
PPO = "04_ppo"
EVALUATE = "05_evaluate"

ROWS = (
    ("wrap", ROBOT, ("wrap",), 1, 10, ("test_01_robot_model", "wrap_")),
    ("compose", ROBOT, ("compose", "relative"), 1, 20, ("test_01_robot_model", "compose_")),
    ("fallen", ROBOT, ("fallen",), 1, 15, ("test_01_robot_model", "fall_means")),
    ("link_frames", ROBOT, ("link_frames",), 2, 45, ("test_01_robot_model", "forward_kinematics")),
    ("leg_inverse", ROBOT, ("leg_inverse",), 3, 120, ("test_01_robot_model", "leg_inverse", "inverse_")),
    ("reflex", ENGINE, ("reflex",), 2, 40, ("test_02_walk_engine", "reflex_")),
    ("capture", ENGINE, ("capture_step", "waiting_pace"), 2, 40,
     ("test_02_walk_engine", "capture_", "waiting_")),
    ("quintic", ENGINE, ("quintic",), 2, 30, ("test_02_walk_engine", "quintic_")),
    ("swing", ENGINE, ("WalkEngine._swing",), 3, 60,
     ("test_02_walk_engine", "swing_", "all_zero", "plans_of_many")),
    ("knot", ENGINE, ("WalkEngine._knot",), 3, 60, ("test_02_walk_engine", "trunk_passes", "plans_of_many")),
    ("encode_goal", ENV, ("encode_goal",), 1, 20, ("test_03_env", "goal_is_encoded", "many_goals")),
    ("actions", ENV, ("to_footsteps", "to_action"), 2, 30, ("test_03_env", "actions_and_footsteps")),
    ("reward_terms", ENV, ("potentials", "reward_terms"), 2, 45,
     ("test_03_env", "reward_formulas", "discounted_progress")),
    ("estimate", ENV, ("predict", "correct"), 2, 45, ("test_03_env", "estimate_")),
    ("clipped_objective", PPO, ("clipped_objective",), 1, 15, ("test_04_ppo", "clipped_objective")),
    ("first_bias", PPO, ("ActorCritic.__init__",), 2, 30, ("test_04_ppo", "first_policy_is"),
     "mode ="),
    ("gae", PPO, ("gae",), 2, 45, ("test_04_ppo", "gae_")),
    ("improve", PPO, ("improve",), 4, 240,
     ("test_04_ppo", "numbers_to_watch", "gradients_are", "advantages_are", "the_old_policy",
      "the_critic_s_weight", "action_", "constant_reward")),
    ("low_pass", EVALUATE, ("low_pass",), 1, 15, ("test_05_evaluate", "the_filter")),
    ("wilson", EVALUATE, ("wilson",), 1, 20, ("test_05_evaluate", "wilson_")),
    ("velocity_command", EVALUATE, ("velocity_command",), 2, 45,
     ("test_05_evaluate", "speed_", "far_away")),
    ("velocity_to_footsteps", EVALUATE, ("velocity_to_footsteps",), 2, 30,
     ("test_05_evaluate", "velocities_become", "a_shared_way")),
    ("time_ratio", EVALUATE, ("bootstrap", "time_ratio"), 2, 45, ("test_05_evaluate", "time_ratio")),
    ("highest_speed", "walk", ("highest_speed",), 2, 30, ("test_02_walk_engine", "highest_speed")),
    ("look_up", "search", ("look_up",), 2, 45, ("test_search", "look_up")),
    ("steps_to_go", "search", ("steps_to_go",), 4, 180, ("test_search", "steps_to_go")),
    ("beta_log_prob", "beta", ("log_beta_function", "beta_log_prob"), 1, 20,
     ("test_beta", "beta_density", "beta_log_prob")),
    ("beta_mode", "beta", ("beta_mode",), 1, 15, ("test_beta", "beta_mode")),
    ("beta_entropy", "beta", ("beta_entropy",), 2, 30, ("test_beta", "beta_entropy")),
)  # fmt: skip
BOOK = {row[0]: Exercise(*row) for row in ROWS}


def graded_by(exercise, key):
    """Does this test, or all of this module, grade the exercise? As pytest calls it."""
    grader, *beginnings = exercise.tests
    module, _, test = key.partition("::test_")
    return module.endswith(f"{grader}.py") and (not test or test.startswith(tuple(beginnings)))


def any_console():
    """Lets the console show ? for a letter that it lacks, as one of Windows may lack ★."""
    if hasattr(sys.stdout, "reconfigure"):  # that of a notebook cannot do this
        sys.stdout.reconfigure(errors="replace")


def command(name, folder="exercises"):
    """How it is graded, from the root of the repository."""
    return f"python -m pytest tests --stages={folder} -k {name}"
