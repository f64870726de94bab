"""Where does the robot fall, after which change of its step, and when within the double step?

    python tests/studies/falls.py [--mujoco] [--ship]

Every fall of all shipped training seeds on 5,000 noisy goals each.
"""

import common
import kept
import numpy as np

DURATION = {"pymunk": "about 4 minutes on two cores", "mujoco": "about 6 minutes on two cores"}
SETS = 10  # of 500 goals
HEAD = ("planner", "noisy walks", "falls", "walking backward, falls / all steps",
        "change of step length, falls / all steps [cm]",
        "while the left foot swings, falls / all steps")

def study(sim):
    """The falls and a sample of the steps that went well, by planner."""
    trials, falls, steps, lines = kept.Trials(sim), {}, {}, []
    for name, paths in kept.shipped_seeds(sim).items():
        parts = [trials.run(*kept.policy(path, sim), True, count=SETS) for path in paths]
        falls[name] = np.concatenate([part["falls"] for part in parts])  # [F, 6]
        steps[name] = np.concatenate([part["changes"] for part in parts])  # [C, 2]
        lines.append([name, sum(len(part["time"]) for part in parts), len(falls[name]),
                      *compare(falls[name], steps[name])])
    trials.close()
    content = {"columns": "goal x, y, yaw; step length, the one before; moment",
               "falls": {name: rows.round(4).tolist() for name, rows in falls.items()}}
    return common.Findings(content, common.markdown(HEAD, lines), plot(falls, steps, sim))

def compare(falls, steps):
    """Three cells of the table: falls against all steps."""
    *_, now, before, when = falls.T
    pairs = ((now < 0, f"{np.mean(steps[:, 0] < 0):.2f}", 2),
             (100 * np.abs(now - before), f"{100 * np.abs(np.diff(steps)).mean():.1f}", 1),
             (when < 0.5, "0.50", 2))
    return [f"{common.number(np.mean(own) if len(falls) else None, digits)} / {usual}"
            for own, usual, digits in pairs]

def plot(falls, steps, sim):
    """A dot for every fall."""
    figure, (place, length, moment) = common.plt.subplots(1, 3, figsize=(12, 3.9),
                                                          layout="constrained")
    length.plot(*steps["policy"].T[::-1], ".", color="0.85", ms=2, label="steps that went well")
    for name, rows in falls.items():
        x, y, _, now, before, _ = rows.T
        kw = {"s": 24, "facecolors": "none", "edgecolors": kept.COLORS[name], "zorder": 3,
              "label": f"{name}: falls: {len(x)}"}
        place.scatter(x, y, **kw)
        length.scatter(before, now, **kw)
    moment.hist([rows[:, 5] for rows in falls.values()], np.linspace(0, 1, 15),
                color=[kept.COLORS[name] for name in falls])
    moment.axvline(0.5, color="0.5", lw=1)  # left foot down, right foot up
    place.plot(0, 0, "k>", ms=8)
    place.set(title="goal, seen from the robot (black)", xlabel="ahead [m]", ylabel="left [m]",
              aspect="equal", xlim=(-2, 2), ylim=(-2, 2))
    length.set(title="forward step length", xlabel="of the step before [m]",
               ylabel="of the step of the fall [m]", aspect="equal")
    moment.set(title="moment of the fall", xlabel="share of the double step: left swing, right",
               ylabel="falls", xlim=(0, 1))
    moment.yaxis.get_major_locator().set_params(integer=True)
    length.legend(fontsize=7)
    figure.suptitle(f"Where, after what and when the robot falls ({sim}, noise)")
    return figure

if __name__ == "__main__":
    common.main(__file__)
