"""The one list of the exercises in which a function is to be written: sheet.py empties it,
grading.py grades it, ../repository/test_workbook.py checks that exercises.md agrees.
"""

import sys
from typing import NamedTuple

ROBOT = "01_robot_model"
ENGINE = "02_walk_engine"
ENV = "03_env"
PPO = "04_ppo"
EVALUATE = "05_evaluate"


class Exercise(NamedTuple):
    name: str  # what `--only` and `-k` call it
    file: str  # its module: a stage, or one in this folder or in ../studies
    stars: int  # 1: follow the formula … 4: an algorithm
    minutes: int
    tests: tuple = ()  # how the names of those that grade it begin; (): like its own
    functions: tuple = ()  # what is to be written, a method with its class; (): that of its name
    since: str = ""  # "": all of the body; else from the statement on that begins like this

    @property
    def grader(self):
        """The module of its tests."""
        return "test_02_walk_engine" if self.file == "walk" else f"test_{self.file}"


ROWS = (
    ("wrap", ROBOT, 1, 10),
    ("compose", ROBOT, 1, 20, (), ("compose", "relative")),
    ("fallen", ROBOT, 1, 15, ("fall_means",)),
    ("link_frames", ROBOT, 2, 45, ("forward_kinematics",)),
    ("leg_inverse", ROBOT, 3, 120, ("leg_inverse", "inverse_")),
    ("reflex", ENGINE, 2, 40),
    ("capture", ENGINE, 2, 40, ("capture_", "waiting_"), ("capture_step", "waiting_pace")),
    ("quintic", ENGINE, 2, 30),
    ("swing", ENGINE, 3, 60, ("swing_", "all_zero", "plans_of_many"), ("WalkEngine._swing",)),
    ("knot", ENGINE, 3, 60, ("trunk_passes", "plans_of_many"), ("WalkEngine._knot",)),
    ("encode_goal", ENV, 1, 20, ("goal_is_encoded", "many_goals")),
    ("actions", ENV, 2, 30, ("actions_and_footsteps",), ("to_footsteps", "to_action")),
    ("reward_terms", ENV, 2, 45, ("reward_formulas", "discounted_progress"), ("potentials", "reward_terms")),
    ("estimate", ENV, 2, 45, (), ("predict", "correct")),
    ("clipped_objective", PPO, 1, 15),
    ("first_bias", PPO, 2, 30, ("first_policy_is",), ("ActorCritic.__init__",), "mode ="),
    ("gae", PPO, 2, 45),
    # Its tests that train come last.
    ("improve", PPO, 4, 240, (
        "numbers_to_watch", "gradients_are", "advantages_are", "the_old_policy",
        "the_critic_s_weight", "action_", "constant_reward",
    )),
    ("low_pass", EVALUATE, 1, 15, ("the_filter",)),
    ("wilson", EVALUATE, 1, 20),
    ("velocity_command", EVALUATE, 2, 45, ("speed_", "far_away")),
    ("velocity_to_footsteps", EVALUATE, 2, 30, ("velocities_become", "a_shared_way")),
    ("time_ratio", EVALUATE, 2, 45, (), ("bootstrap", "time_ratio")),
    ("highest_speed", "walk", 2, 30),
    ("look_up", "search", 2, 45),
    ("steps_to_go", "search", 4, 180),
    ("beta_log_prob", "beta", 1, 20, ("beta_density", "beta_log_prob"), ("log_beta_function", "beta_log_prob")),
    ("beta_mode", "beta", 1, 15),
    ("beta_entropy", "beta", 2, 30),
)  # fmt: skip
BOOK = {}
for row in ROWS:
    exercise = Exercise(*row)
    own = (exercise.name,)
    BOOK[exercise.name] = exercise._replace(
        tests=exercise.tests or own, functions=exercise.functions or own
    )


def graded_by(exercise, key):
    """Does this test, or all of this module, grade the exercise? As pytest calls it."""
    module, _, test = key.partition("::test_")
    return module.endswith(f"{exercise.grader}.py") and (
        not test or test.startswith(exercise.tests)
    )


def any_console():
    """Lets the console show ? for a letter that it lacks, as one of Windows may lack ★."""
    if hasattr(sys.stdout, "reconfigure"):  # that of a notebook cannot do this
        sys.stdout.reconfigure(errors="replace")


def command(name, folder="exercises"):
    """How it is graded, from the root of the repository."""
    return f"python -m pytest tests --stages={folder} -k {name}"
