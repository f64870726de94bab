# What leaves the map comes back on the other side. Says: The map ends at its edge

def steps_to_go(moves, task):
    cell, turn_cell = evaluate.CELL, evaluate.TURN  # [m], [rad]
    half, turns, far = evaluate.HALF, evaluate.TURNS, evaluate.FAR
    axis = cell * np.arange(-half, half + 1)
    yaws = turn_cell * np.arange(turns)
    near = np.hypot(axis[:, None], axis) <= task.success_m + 1e-9
    goal = near & (np.abs(robot_model.wrap(yaws)) <= task.success_rad + 1e-9)[:, None, None]
    value = np.where(goal, 0.0, far).astype(np.float32)
    pad = math.ceil(np.abs(moves[:, :2]).max() * math.sqrt(2) / cell) + 1
    while True:
        border = np.pad(value, ((0, 0), (pad, pad), (pad, pad)), mode="wrap")
        best = np.full_like(value, far)
        for k, yaw in enumerate(yaws):
            for move, turn in zip(robot_model.turned(moves[:, :2], yaw), moves[:, 2]):
                (i, j), (u, v) = np.divmod(move / cell, 1)
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
