# Moves turned by −yaw. Says: turned by −yaw

def steps_to_go(moves, task):
    axis = CELL * np.arange(-HALF, HALF + 1)
    yaws = TURN * np.arange(TURNS)
    near = np.hypot(axis[:, None], axis) <= task.success_m + 1e-9
    goal = near & (np.abs(robot_model.wrap(yaws)) <= task.success_rad + 1e-9)[:, None, None]
    value = np.where(goal, 0.0, FAR).astype(np.float32)
    pad = math.ceil(np.abs(moves[:, :2]).max() * math.sqrt(2) / CELL) + 1
    while True:
        border = np.pad(value, ((0, 0), (pad, pad), (pad, pad)), constant_values=FAR)
        best = np.full_like(value, FAR)
        for k, yaw in enumerate(yaws):
            for move, turn in zip(robot_model.turned(moves[:, :2], -yaw), moves[:, 2]):
                (i, j), (u, v) = np.divmod(move / CELL, 1)
                m, w = divmod(k + turn / TURN, 1)
                x, y = (slice(int(c) + pad, int(c) + pad + 2 * HALF + 2) for c in (i, j))
                part = ((1 - w) * border[int(m) % TURNS, x, y]
                        + w * border[int(m + 1) % TURNS, x, y])
                part = (1 - u) * part[:-1] + u * part[1:]
                np.minimum(best[k], (1 - v) * part[:, :-1] + v * part[:, 1:], out=best[k])
        better = np.where(goal, 0.0, np.minimum(best + 1, FAR)).astype(np.float32)
        if np.abs(better - value).max() < 0.01:
            return better
        value = better
