"""Where does the robot fall, after which change of its step, on what ground, and unannounced?

    python tests/studies/falls.py [--mujoco] [--ship]

Every fall of all shipped training seeds on 5,000 near and 5,000 far noisy goals each, and those of
`search`, which is blind to dynamics. A fall is announced if the double step before it ended with
the torso's pitch beyond ±0.25 rad: so much an IMU could tell.
"""

import common
import kept
import numpy as np

DURATION = {"pymunk": "about 2 minutes on two cores after seeds.py and imu.py, else 20",
            "mujoco": "about 9 minutes on two cores after imu.py, else 25"}
SETS = 10  # of 500 goals, near and far
HEAD = ("planner", "walks", "falls", "walking backward",
        "mean change of step length before it [cm]", "μ of the ground, median (all walks)",
        "announced: pitch beyond 0.25 rad one double step earlier (all double steps)")

def study(sim):
    """The falls by planner."""
    planners = {name: [kept.policy(path, sim) for path in paths]
                for name, paths in kept.shipped_seeds(sim).items()}
    planners["search"] = [kept.opponents(sim)["search"]]
    trials, falls, lines, content = kept.Trials(sim), {}, [], []
    for name, own in planners.items():
        parts = [trials.run(*planner, True, count=SETS, far=far)
                 for planner in own for far in (False, True)]
        falls[name] = np.concatenate([part["falls"] for part in parts])  # [F, 8]
        row = {"planner": name, **facts(parts, falls[name])}
        content.append(row)
        lines.append([name, row["walks"], row["falls"], common.number(row["backward"], 2),
                      common.number(row["change_cm"], 1),
                      f"{common.number(row['mu'], 2)} ({row['mu_all']:.2f})",
                      f"{common.number(row['announced'], 2)} ({row['tilted']:.4f})"])
    trials.close()
    columns = "goal x, y, yaw; step length, the one before; pitch before; moment; μ"
    one_by_one = {name: rows.round(4).tolist() for name, rows in falls.items()}
    return common.Findings({"rows": content, "columns": columns, "falls": one_by_one},
                           common.markdown(HEAD, lines), plot(falls, sim))

def facts(parts, falls):
    """Falls [F, 8] against all walks of `kept.Trials.run`; None where nobody fell."""
    _, _, _, now, before, pitch, _, mu = falls.T
    count = {key: np.concatenate([part[key] for part in parts])
             for key in ("steps", "tilted", "friction")}
    row = {"walks": len(count["steps"]), "falls": len(falls)}
    if len(falls):
        row |= {"backward": np.mean(now < 0), "change_cm": 100 * np.abs(now - before).mean(),
                "mu": np.median(mu), "announced": np.mean(np.abs(pitch) > kept.TILTED)}
    row |= {"mu_all": np.median(count["friction"]),
            "tilted": count["tilted"].sum() / count["steps"].sum()}
    empty = dict.fromkeys(("backward", "change_cm", "mu", "announced"))
    return empty | {name: round(float(value), 4) if isinstance(value, float) else value
                    for name, value in row.items()}

def plot(falls, sim):
    """A dot for every fall; the friction of all of them."""
    figure, axes = common.plt.subplots(1, 4, figsize=(15, 3.9), layout="constrained")
    place, length, tilt, ground = axes
    for name, rows in falls.items():
        x, y, _, now, before, pitch, moment, mu = rows.T
        kw = {"s": 18, "color": kept.COLORS[name], "marker": kept.MARKERS[name], "alpha": 0.5,
              "label": f"{name}: {len(x)} falls"}
        place.scatter(x, y, **kw)
        length.scatter(before, now, **kw)
        tilt.scatter(moment, pitch, **kw)
        if len(mu) >= 20:  # of fewer, shares say nothing
            ground.hist(mu, np.linspace(0.4, 1.0, 13), histtype="step", color=kept.COLORS[name],
                        weights=np.full(len(mu), 1 / len(mu)))
    place.plot(0, 0, "k>", ms=8)
    place.set(title="goal, seen from the robot (black)", xlabel="ahead [m]", ylabel="left [m]",
              aspect="equal", xlim=(-2, 2), ylim=(-2, 2))
    length.set(title="forward step length", xlabel="of the step before [m]",
               ylabel="of the step of the fall [m]", aspect="equal")
    for edge in (-kept.TILTED, kept.TILTED):
        tilt.axhline(edge, color="0.6", lw=1)
    tilt.axvline(0.5, color="0.6", lw=1)  # left foot down, right foot up
    tilt.set(title="was it announced?", xlabel="moment: left swing, right swing", xlim=(0, 1),
             ylabel="pitch when the step began [rad]")
    ground.set(title="ground", xlabel="friction μ [1]", ylabel="share of the falls [1]")
    length.legend(fontsize=7)
    figure.suptitle(f"Where, after what and on which ground the robot falls ({sim}, noise)")
    return figure

if __name__ == "__main__":
    common.main(__file__)
