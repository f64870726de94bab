"""A policy is a distribution: should it decide by its mode, its mean, or half-way between?

    python tests/studies/decision.py [--mujoco] [--ship]

All shipped training seeds, each on the same 1,000 noisy goals with every rule.
"""

import common
import kept

DURATION = {"pymunk": "about 4 minutes on two cores", "mujoco": "about 5 minutes on two cores"}
SETS = 2  # of 500 goals
RULES = {"mode (paper)": 0.0, "half-way (ours)": kept.ppo.MEAN_SHARE, "mean": 1.0}

class SharePlanner(kept.evaluate.PolicyPlanner):
    """A policy that decides between its mode (share 0) and its mean (share 1)."""

    def __init__(self, planner, share):
        super().__init__(planner.model, planner.imu)
        self.share = share

    def act(self, world, robots, measured):
        return self.model.decide(world.observe(robots, measured, self.imu), self.share)

def study(sim):
    """Every planner by every rule."""
    trials, rows, lines = kept.Trials(sim), [], []
    for name, paths in kept.shipped_seeds(sim).items():
        for rule, share in RULES.items():
            own = []
            for seed, path in zip(kept.SEEDS, paths):
                planner, (file, _) = kept.policy(path, sim)
                result = trials.run(SharePlanner(planner, share), (file, share), True, count=SETS)
                own.append({"rule": rule, "seed": seed, **kept.row_of(result, name, True)})
            rows += own
            cells = (common.spread([row[key] for row in own], digits)
                     for key, digits in (("success", 4), ("fall", 4), ("time_mean", 2)))
            lines.append([name, rule, *cells])
    trials.close()
    head = ["planner", "decides by", "success", "fall", "time [s]"]
    return common.Findings({"goals": SETS * kept.PER_SEED, "rows": rows},
                           common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
