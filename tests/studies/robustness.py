"""Is it the simulator's accident? Three planners in worlds they were not made for.

    python tests/studies/robustness.py [--mujoco] [--ship]

1,000 near and 1,000 far goals with noise in each world. Nobody is told which one it is. (The two
worlds on static friction came last, to find out why the bare model falls more than the drawn ones.)
"""

import common
import kept
from kept import robot_model

DURATION = {"pymunk": "about 10 minutes on two cores", "mujoco": "about 22 minutes on two cores"}
SETS = 2  # of 500 goals

class Soft(robot_model.Spread):
    """Every motor has 2/3 of the stiffness it would have drawn."""

    def draw(self, rngs, robot):
        body = super().draw(rngs, robot)
        body.stiffness = body.stiffness * 2 / 3
        return body

WORLDS = {  # spread, and friction if it is not drawn
    "as trained": (robot_model.Spread(), {}),
    "μ = 0.3 (trained: 0.4 to 1.0)": (robot_model.Spread(), {"friction": 0.3}),
    "μ = 1.2": (robot_model.Spread(), {"friction": 1.2}),
    "masses ± 20 % (± 10 %)": (robot_model.Spread(mass=0.2), {}),
    "2/3 of the motors' stiffness": (Soft(), {}),
    "no static friction in the joints": (robot_model.Spread(stiction=0.0), {}),
    "nothing but static friction": (robot_model.Spread(0, 0, 0, delay=0), {}),
    "no spread at all: the model, μ = 0.7": (robot_model.Spread(0, 0, 0, 0, 0), {}),
}

def study(sim):
    """The planners in every world."""
    planners = kept.shipped(sim)
    names, rows, lines = ("policy", "baseline_tuned", "search"), [], []
    for title, (spread, ground) in WORLDS.items():
        trials = kept.Trials(sim, spread)
        for far in (False, True):
            line = [title, "far" if far else "near"]
            for name in names:
                ended = trials.run(*planners[name], True, count=SETS, far=far, **ground)
                row = kept.row_of(ended, name, True, far)
                rows.append({"world": title, **row})
                line += [f"{row['success']:.3f}", common.with_interval(row, "fall"),
                         common.number(row["time_mean"], 2)]
            lines.append(line)
        trials.close()
    head = ["world", "goals", *(f"{name}: {what}" for name in names
                                for what in ("success", "fall [95 % interval]", "time [s]"))]
    return common.Findings(rows, common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
