"""Does the robot walk where it was not trained: with joints whose zeros are wrong, as another robot?

    python tests/studies/transfer.py --mujoco                            zeros of joints; OP3
    python tests/studies/transfer.py --mujoco --only zeros --walks 20    fewer walks, for a lesson

Nothing is trained or tuned here. The robots walk to far goals, without pushes and with them, as in
`seeds.py`, but to other goals. Guess first: what costs more time, a degree in each joint, or half of
the mass?

Two more tables of transfer.json were measured at commit b097353, whose transfer.py can do so again:
`bullet`, our robot in PyBullet, and `urdf`, the model of the robot by its own team.
"""

import sys
from dataclasses import replace

import common
import numpy as np
import seeds
from common import env, evaluate, robot_model, walk_engine

sys.path.append(str(common.ROOT / "tests" / "course" / "starters"))
import op3

DURATION = "5 minutes on one core"
ZEROS = {f"joint zeros, σ {k / 2:g}°": k * env.Spread.zero for k in (2, 4)}  # ours: 0.5°
SEED = 201  # of the evaluation; no other study uses it


def measure(args, cases, **more):
    """Rows of the policy and its best two opponents, see `seeds.walked`, in each case; cases: settings
    of the world by name; more: opponents."""
    if args.walks < 1:
        raise robot_model.InputError("--walks from 1 on")
    policy, rows = {None: common.shipped(args.sim)}, []
    opponents = common.opponents(args.sim) | more
    for case, settings in cases.items():
        how = {"kinds": seeds.KINDS[1:], "num_robots": args.walks, **settings}  # far goals
        found = seeds.walked(args.sim, policy, 1, opponents, SEED, **how)
        found["rows"].sort(key=lambda row: (row["push"], row["planner"] != "policy"))
        for row in found["rows"]:
            late = round(row["timeout"] * row["episodes"])
            rows.append({"case": case} | row | {"time-outs": late})
    return rows


def study_zeros(args):
    """Our own model, with zeros of the joints as in training and with larger errors."""
    zeros = {name: {"spread": env.Spread(zero=zero)} for name, zero in ZEROS.items()}
    return measure(args, {"our model": {}} | zeros)


def study_op3(args):
    """Another robot with a walk of its own: `tests/course/starters/op3.py`."""
    # An action is a share of the limits, so the policy's speeds shrink with them. So may its rival's.
    tuned, now = evaluate.TUNED_BASELINE[args.sim], walk_engine.TUNED[args.sim]
    share = np.divide(op3.LIMITS.high, env.LIMITS[args.sim].high)
    x, y, yaw = share * now.step_ticks / op3.WALK.step_ticks
    ahead = {"forward": x * tuned.forward, "backward": x * tuned.backward}
    slower = replace(tuned, **ahead, sideways=y * tuned.sideways, turning=yaw * tuned.turning)
    world = {"robot": op3.ROBOT, "walk": op3.WALK, "limits": op3.LIMITS}
    return measure(args, {"OP3": world}, baseline_scaled=evaluate.BaselinePlanner(slower))


FLAGS = {"walks": {"type": int, "default": 200, "help": "for each row"}}
PARTS = ONLY_3D = {"zeros": study_zeros, "op3": study_op3}


SHOWN = {"case": 0, "push": 1, ("falls", "planner"): 0, ("time_mean", "planner"): 2}
SHOWN |= {"over_baseline_tuned": 3, "over_baseline_scaled": 3}
COLUMNS = dict.fromkeys([*PARTS, "bullet", "urdf"], SHOWN)
COLUMNS["zeros"] = SHOWN | {("time-outs", "planner"): 0}  # elsewhere there are none


if __name__ == "__main__":
    common.start("transfer")
