"""How far does pure search get? And what does it cost to be blind to dynamics?

    python tests/studies/search.py [--mujoco] [--ship]

The planner `search` of stage 5 with step sizes of 20 % to all that the limits allow, and with a
largest change from one double step to the next: every combination on 200 noisy tuning trials, half
of them far. The five best in time, falls and time-outs are walked again on 2,000 others. Kept is
the fastest with at most 0.5 % falls that stays; if none does, the fastest with so few falls; if
there is none either, the one that falls least (search.npz; the "rule" in search.json says which it
was). The figure shows all of them beside all the carrots that the study `baseline` has tried.
"""

import json
import math

import baseline
import common
import kept
import numpy as np
from kept import env, evaluate, robot_model
from tqdm import tqdm

DURATION = {"pymunk": "about 10 minutes on two cores", "mujoco": "about 20 minutes on two cores"}
FACTORS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 1.0)  # [-] on the limits of a step
CHANGES = (0.1, 0.2, 0.35, 1.0)  # [share of limits] from one double step to the next; 1: any
WALKS, FINALISTS = 100, 5

def double_steps(limits, factor=1.0):
    """A finite set of double steps [A, 2, 3] to search over; the first one is in place.

    8 lengths × 5 sideways × 7 turns, within the limits times a factor.
    """
    low, high = factor * np.array(limits.low), factor * np.array(limits.high)
    x, side, turn = np.linspace(low[0], high[0], 8), np.linspace(-1, 1, 5), np.linspace(-1, 1, 7)
    x, side, turn = np.stack(np.meshgrid(x, side, turn, indexing="ij"), -1).reshape(-1, 3).T
    steps = np.zeros((len(x) + 1, 2, 3))
    steps[1:, :, 0] = x[:, None]
    for axis, share in ((1, side), (2, turn)):  # the left foot outward, the right one inward
        for foot, s in enumerate((share, -share)):
            steps[1:, foot, axis] = np.maximum(s, 0) * high[axis] + np.maximum(-s, 0) * low[axis]
    return evaluate.walk_engine.within(steps, limits)

def displacements(sim, steps):
    """Where each of the double steps [A, 2, 3] takes the robot, seen from where it was [A, 3].

    Measured once, at the middle of the spread, the mean of both delays: the third to sixth of six
    in a row. Also returns which of them stood, bool [A].
    """
    plans = np.repeat(np.tile(steps, (2, 1, 1))[:, None], 6, 1)  # [2·A, 6, 2, 3]
    n, spread, friction = len(plans), robot_model.Spread(), robot_model.RobotModel().friction
    body = robot_model.Body(np.full(n, friction), np.ones((n, 9)), np.ones((n, 12)),
                            np.full((n, 12), spread.stiction / 2),
                            np.repeat([0, spread.delay], len(steps)))
    poses, _, fall = evaluate.walk_engine.walk(sim, evaluate.walk_engine.TUNED[sim], plans, body)
    moved = robot_model.relative(poses[:, 2:-1], poses[:, 3:])  # [2·A, 4, 3]
    return (moved.reshape(2, len(steps), 4, 3).mean((0, 2)),
            (fall == 6).reshape(2, len(steps)).all(0))

def steps_to_go(moves, task):
    """How many double steps it takes to the goal, from every pose around it: dynamic programming.

    moves [A, 3]: what a double step does. Returns V [TURNS, 2·HALF + 1, 2·HALF + 1] over the
    robot's yaw, x and y as seen from the goal:

        V = 0 at the goal,   V(pose) = 1 + min over moves of V(pose after the move)

    repeated until nothing changes. Between the cells V is linear in x, y and yaw. It is the paper's
    A* for all starts at once, as it begins at the goal.
    """
    cell, turn_cell = evaluate.CELL, evaluate.TURN  # [m], [rad]
    half, turns, far = evaluate.HALF, evaluate.TURNS, evaluate.FAR
    axis = cell * np.arange(-half, half + 1)
    yaws = turn_cell * np.arange(turns)
    near = np.hypot(axis[:, None], axis) <= task.success_m + 1e-9
    goal = near & (np.abs(robot_model.wrap(yaws)) <= task.success_rad + 1e-9)[:, None, None]
    value = np.where(goal, 0.0, far).astype(np.float32)
    pad = math.ceil(np.abs(moves[:, :2]).max() * math.sqrt(2) / cell) + 1  # cells beyond the map
    while True:
        border = np.pad(value, ((0, 0), (pad, pad), (pad, pad)), constant_values=far)
        best = np.full_like(value, far)
        for k, yaw in enumerate(yaws):
            for move, turn in zip(robot_model.turned(moves[:, :2], yaw), moves[:, 2]):
                # Seen from the goal, a move shifts all the poses of one yaw alike.
                (i, j), (u, v) = np.divmod(move / cell, 1)  # whole cells, and what is left
                m, w = divmod(k + turn / turn_cell, 1)
                x, y = (slice(int(c) + pad, int(c) + pad + 2 * half + 2) for c in (i, j))
                part = ((1 - w) * border[int(m) % turns, x, y]
                        + w * border[int(m + 1) % turns, x, y])
                part = (1 - u) * part[:-1] + u * part[1:]
                np.minimum(best[k], (1 - v) * part[:, :-1] + v * part[:, 1:], out=best[k])
        better = np.where(goal, 0.0, np.minimum(best + 1, far)).astype(np.float32)
        if np.abs(better - value).max() < 0.01:
            return better
        value = better

def save(path, sim, factor, change, table):
    """(steps, moves, value) as a small file: the differences of V, in twentieths of a step."""
    steps, moves, value = table
    about = {"fits": env.fingerprint(sim), "factor": factor, "change": change}
    parts = np.diff(np.round(20 * value), axis=2, prepend=0).astype(np.int16)
    common.robot_model.atomic_write(path, lambda file: np.savez_compressed(
        file, about=json.dumps(about), steps=steps, moves=moves, parts=parts))

def table(sim, factor):
    """(steps, moves, value) for step sizes up to that factor; kept."""
    limits = evaluate.walk_engine.LIMITS[sim]
    key = common.digest(env.fingerprint(sim), factor, evaluate.CELL, evaluate.TURN, evaluate.HALF)
    path = common.work(sim, "search") / f"{key}.npz"
    if not path.is_file():
        steps = double_steps(limits, factor)
        moves, stood = displacements(sim, steps)
        value = steps_to_go(moves[stood], env.Task())
        save(path, sim, factor, 1.0, (steps[stood], moves[stood], value))
    with np.load(path) as stored:
        planner = evaluate.load(path, sim)[1]
        return stored["steps"], stored["moves"], planner.value

def planner(sim, factor, change):
    """The planner, and what it depends on."""
    limits = evaluate.walk_engine.LIMITS[sim]
    steps, moves, value = table(sim, factor)
    key = "search", factor, change, moves.tobytes()
    return evaluate.SearchPlanner(steps, moves, value, limits, change), key

def study(sim):
    """The grid, then the finalists."""
    trials, tried = kept.Trials(sim), []
    for factor in FACTORS:
        for change in tqdm(CHANGES, desc=f"factor {factor}", leave=False):
            ended = baseline.both(trials, planner(sim, factor, change), True, 1, 1, WALKS)
            tried.append({"factor": factor, "change": change, **baseline.facts(ended)})
    paper = baseline.final(trials, kept.baseline(baseline.Settings()))
    tried.sort(key=lambda row: baseline.cost(row | {"still_there": 1.0}, paper))
    rows = []
    for row in tried[:FINALISTS]:
        own = planner(sim, row["factor"], row["change"])
        rows.append(row | {"planner": own, **baseline.final(trials, own)})
    best, rule = baseline.choose(trials, rows, paper)
    trials.close()
    file = common.work(sim) / "search.npz"
    save(file, sim, best["factor"], best["change"], table(sim, best["factor"]))
    lines = [[row["factor"], row["change"], f"{row['fall']:.4f}", f"{row['timeout']:.4f}",
              common.number(row["time"], 2), common.number(row["still_there"], 3),
              f"{row['quiet']:.3f}" if "quiet" in row else "", "chosen" * (row is best)]
             for row in rows]
    head = ["step size", "largest change", "fall", "timeout", "time [s]", "still there",
            "without noise", ""]
    content = {"trials": 2 * baseline.SETS * kept.PER_SEED, "rule": rule, "tried": tried,
               "finalists": [{key: row[key] for key in row if key != "planner"} for row in rows]}
    return common.Findings(content, common.markdown(head, lines), plot(tried, sim, best),
                           {"search.npz": file})

def plot(tried, sim, best):
    """Falls against time, every setting a dot; best: the one that was kept."""
    figure, axis = common.plt.subplots(figsize=(7, 4.5), layout="constrained")
    carrots = common.read_json(common.RUNS / sim / "baseline.json")["tried"]
    for rows, name in ((carrots, "baseline_tuned"), (tried, "search")):
        known = [(row["time"], row["fall"]) for row in rows if row["time"] is not None]
        label = f"{name}: {len(known)} settings"
        axis.plot(*np.transpose(known), kept.MARKERS[name], ms=8, mew=2, color=kept.COLORS[name],
                  label=label, alpha=0.7)
    kept_one = next(row for row in tried
                    if all(row[key] == best[key] for key in ("factor", "change")))
    axis.plot(kept_one["time"], kept_one["fall"], "o", ms=15, mfc="none", mec="black",
              label="the search that was kept")
    axis.axhline(baseline.MAX_FALLS, color="0.6", lw=1, label="0.5 % falls")
    axis.set(xlabel="mean time of the successes [s]", ylabel="share of walks that fell [1]",
             title=f"What it costs to be fast, and blind ({sim})")
    axis.set_yscale("symlog", linthresh=0.01)
    axis.set_ylim(-0.002, 1)
    axis.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=2, fontsize=9)
    return figure

if __name__ == "__main__":
    common.main(__file__)
