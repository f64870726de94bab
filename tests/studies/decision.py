"""A policy is a distribution: should it decide by its mode, its mean, or half-way between?

    python tests/studies/decision.py [--mujoco] [--ship]

The three shipped trainings without IMU, each on the same 2,000 near and 2,000 far noisy goals with
every rule. As this is a choice, it is made on goals of the tuning; on the goals of seeds.py one
sees what it is worth where nobody has chosen anything. The mean depends on the sharpness k of
`ActorCritic` (the mode does not): it is the last one of the training.
"""

import itertools

import common
import kept
from kept import env, ppo

DURATION = {"pymunk": "20 minutes, estimated", "mujoco": "about 25 minutes on two cores"}
SETS = 4  # of 500 goals
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
    """Every training by every rule."""
    trials, rows, lines = kept.Trials(sim), [], []
    policies = {seed: kept.policy(path, sim)
                for seed, path in zip(kept.SEEDS, kept.shipped_seeds(sim)["policy"])}
    for purpose, far in itertools.product(("tuning", "evaluation"), (False, True)):
        for rule, share in RULES.items():
            own = []
            for seed, (planner, file) in policies.items():
                ended = trials.run(SharePlanner(planner, share), (file, share), True, count=SETS,
                                   far=far, purpose=purpose)
                row = kept.row_of(ended, "policy", True, far)
                own.append({"purpose": purpose, "rule": rule, "seed": seed, **row})
            rows += own
            digits = {"success": 4, "fall": 4, "still_there": 3, "time_mean": 2}
            cells = (common.spread([row[key] for row in own], n) for key, n in digits.items())
            lines.append([purpose, "far" if far else "near", rule, *cells])
    trials.close()
    head = ["goals of the", "", "decides by", "success", "fall", "still there", "time [s]"]
    return common.Findings({"goals": SETS * kept.PER_SEED, "rows": rows},
                           common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
