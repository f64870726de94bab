"""Was the walk a lucky one? Tuned again from nothing, mapped, and learned with; 3-D only.

    python tests/studies/second_walk.py [--mujoco] [--ship]

The tuning of stage 2 begins at its first guess, `WalkParameters()`, with seed 1, and goes on with
seed 2; ours stays as it is. Then both are measured on the same other worlds, the second
one gets its maps (see limits.py; with the limits of ours), and a policy is trained on it with seed
0: 2,000 noisy goals a block, beside the three policies of seeds.py. The spread between the walks
says how much of a result belongs to the walk, and not to the learning.
"""

import contextlib
from dataclasses import asdict, fields

import common
import kept
import limits
from kept import env, ppo, robot_model

walk_engine = env.walk_engine
DURATION = {"pymunk": "it needs --mujoco", "mujoco": "about 65 minutes on two cores"}
TUNINGS = (1, 2)  # seeds
WORLDS = range(100, 104)  # seeds of the worlds in which both walks are measured
STEPS = ppo.STEPS  # double steps of the training
SETS = 4  # of 500 goals

@contextlib.contextmanager
def walking(parameters):
    """Meanwhile every 3-D robot walks with these parameters."""
    ours = walk_engine.TUNED["mujoco"]
    walk_engine.TUNED["mujoco"] = parameters
    try:
        yield
    finally:
        walk_engine.TUNED["mujoco"] = ours

def tuned_again():
    """WalkParameters of the second walk; every tuning is kept."""
    found = walk_engine.WalkParameters()
    for seed in TUNINGS:
        key = common.digest(found, walk_engine.SEARCH, robot_model.RobotModel(),
                            robot_model.Spread(), walk_engine.LIMITS["mujoco"])
        path = common.work("mujoco", "second_walk") / f"{seed}_{key}.json"
        if not path.is_file():
            with walking(found):
                common.write(path, common.as_json(asdict(walk_engine.tune("mujoco", seed))))
        found = walk_engine.WalkParameters(**common.read_json(path))
    return found

def learned():
    """Rows of a policy on the second walk, near and far; `walking` is on."""
    fits, cfg, trials = env.fingerprint("mujoco"), ppo.PPOConfig(), kept.Trials("mujoco")
    out = common.work("mujoco") / f"second_walk_{kept.settings_of('mujoco')}_{STEPS}"
    if not (out / "policy.pt").is_file():
        kept.learn(out, cfg, lambda n: env.FootstepVectorEnv(n, "mujoco", noise=True), STEPS, 0,
                   about={"fits": fits, "imu": False, "noise": True})
    planner = kept.policy(out / "policy.pt", "mujoco")
    rows = [kept.row_of(trials.run(*planner, True, count=SETS, far=far), "policy", True, far)
            for far in (False, True)]
    trials.close()
    return rows

def study(sim):
    """Both walks."""
    if sim != "mujoco":
        raise common.StudyError("the walk was tuned longest in 3-D: add --mujoco")
    walks = {"ours": walk_engine.TUNED["mujoco"], "the second": tuned_again()}
    measured = {}
    for name, parameters in walks.items():
        with walking(parameters):
            measured[name] = walk_engine.average(
                [walk_engine.measure(sim, parameters, seed) for seed in WORLDS])
    with walking(walks["the second"]):
        maps, policy = limits.study(sim), learned()
    maps.figure.suptitle("What the second walk can take in drawn worlds; blue: the limits of ours")
    seeds = [row for row in common.read_json(common.RESULTS / sim / "studies" / "seeds.json")[
        "rows"] if row["planner"] == "policy" and row["noise"]]
    numbers = {"walks": {name: asdict(one) for name, one in walks.items()}, "measured": measured,
               "policy": policy, "maps": maps.numbers}
    text = [table_of(walks), *(f"{name}: {walk_engine.in_words(one)}\n"
                               for name, one in measured.items()),
            race(policy, seeds), "Maps of the second walk:\n", maps.table]
    return common.Findings(numbers, "\n".join(text), maps.figure)

def table_of(walks):
    """The parameters side by side."""
    lines = [[entry.name, *(f"{getattr(one, entry.name):.4f}" for one in walks.values())]
             for entry in fields(walk_engine.WalkParameters)]
    return common.markdown(["parameter (units: see stage 2)", *walks], lines)

def race(policy, seeds):
    """A policy on the second walk beside the range of three on ours."""
    lines = []
    for row in policy:
        ours = [one for one in seeds if one["goal_std_m"] == row["goal_std_m"]]
        for name, rows in (("ours, three seeds", ours), ("the second, seed 0", [row])):
            cells = [common.spread([one[key] for one in rows], digits) for key, digits in (
                ("success", 4), ("fall", 4), ("still_there", 3), ("time_mean", 2))]
            lines.append([f"σ {row['goal_std_m']} m", name, *cells])
    return common.markdown(["goals", "policy on", "success", "fall", "still there", "time [s]"],
                           lines)

if __name__ == "__main__":
    common.main(__file__)
