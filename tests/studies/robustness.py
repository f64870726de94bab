"""Is it the simulator's accident? Policy and tuned baseline in worlds they were not made for.

    python tests/studies/robustness.py [--mujoco] [--ship]

500 goals without noise in each world. (A double step takes whole control ticks: with half of them
it may last a little less or more.)
"""

from dataclasses import replace

import common
import kept

DURATION = {"pymunk": "about 2 minutes on two cores", "mujoco": "about 3 minutes on two cores"}
MODEL = kept.robot_model.RobotModel()
WORLDS = {  # what differs in the robot model
    "as trained": {},
    "half the time step": {"substeps": 2 * MODEL.substeps},
    "half the time step and control tick": {"control_dt": MODEL.control_dt / 2},
    "friction 0.4": {"friction": 0.4},
    "friction 0.7": {"friction": 0.7},
    "2/3 of the motors' stiffness": {"stiffness": MODEL.stiffness * 2 / 3,
                                     "planar_gain": MODEL.planar_gain * 2 / 3},
}
ONLY = {"mujoco": {"elliptic friction cone": {}},
        "pymunk": {"twice the solver's iterations":
                   {"planar_iterations": 2 * MODEL.planar_iterations}}}

class EllipticTrials(kept.Trials):
    """Friction alike in all directions; MuJoCo's pyramid carries less between its edges."""

    def run(self, planner, key, *args, **kw):
        return super().run(planner, (key, "elliptic"), *args, **kw)

    def make_world(self):
        import mujoco

        world = super().make_world()
        world.sim.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        return world

def study(sim):
    """Both planners in every world."""
    planners = {name: kept.shipped(sim)[name] for name in ("policy", "baseline_tuned")}
    rows, lines = [], []
    for title, change in (WORLDS | ONLY[sim]).items():
        kind = EllipticTrials if title.startswith("elliptic") else kept.Trials
        trials, line = kind(sim, replace(MODEL, **change)), [title]
        for name, planner in planners.items():
            row = kept.row_of(trials.run(*planner, False, count=1), name, False)
            rows.append({"world": title, "change": change, **row})
            line += [common.with_interval(row, "success"), common.number(row["time_mean"], 2)]
        trials.close()
        lines.append(line)
    head = ["world", *(f"{name}: {what}" for name in planners
                       for what in ("success [95 % interval]", "time [s]"))]
    return common.Findings(rows, common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
