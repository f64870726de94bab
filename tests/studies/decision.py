"""A policy is a distribution: should it decide by its mode, its mean, or half-way between?

    python tests/studies/decision.py [--mujoco] [--ship]

All shipped training seeds, each on the same 1,000 near and 1,000 far noisy goals with every rule;
as this is a choice, on goals of the tuning. The mean depends on the sharpness k of `ActorCritic`
(the mode does not): it is the last one of the training.
"""

import common
import kept
from kept import env, ppo

DURATION = {"pymunk": "about 9 minutes on two cores", "mujoco": "about 12 minutes on two cores"}
SETS = 2  # of 500 goals
RULES = {"mode (paper)": 0.0, "half-way": 0.5, "mean (ours)": 1.0}

class SharePlanner(kept.evaluate.PolicyPlanner):
    """A policy that decides between its mode (share 0) and its mean (share 1)."""

    def __init__(self, planner, share):
        super().__init__(planner.model, planner.imu)
        self.share = share

    def act(self, view, robots, measured):
        """Actions [n, 6] of these robots."""
        seen = view.observation[:, : len(env.observation_table(self.imu))]
        with ppo.torch.no_grad():
            pi = self.model.policy(ppo.torch.as_tensor(seen))
            return ((1 - self.share) * pi.mode + self.share * pi.mean).numpy()

def study(sim):
    """Every planner by every rule."""
    trials, rows, lines = kept.Trials(sim), [], []
    for name, paths in kept.shipped_seeds(sim).items():
        for far in (False, True):
            for rule, share in RULES.items():
                own = []
                for seed, path in zip(kept.SEEDS, paths):
                    planner, file = kept.policy(path, sim)
                    planner, key = SharePlanner(planner, share), (file, share)
                    ended = trials.run(planner, key, True, count=SETS, far=far, purpose="tuning")
                    row = kept.row_of(ended, name, True, far)
                    own.append({"rule": rule, "seed": seed, **row})
                rows += own
                digits = {"success": 4, "fall": 4, "still_there": 3, "time_mean": 2}
                cells = (common.spread([row[key] for row in own], n) for key, n in digits.items())
                lines.append([name, "far" if far else "near", rule, *cells])
    trials.close()
    head = ["planner", "goals", "decides by", "success", "fall", "still there", "time [s]"]
    return common.Findings({"goals": SETS * kept.PER_SEED, "rows": rows},
                           common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
