# Between the last yaw and the first. Says: after the last yaw, the first

def look_up(value, poses):
    edge = CELL * HALF - 1e-6
    x, y = (np.clip(poses[..., k], -edge, edge) / CELL + HALF for k in (0, 1))
    i, j, k = (np.floor(c).astype(int) for c in (x, y, poses[..., 2] / TURN))
    u, v, w = x - i, y - j, poses[..., 2] / TURN - k
    total = 0.0
    for a, b, c in np.ndindex(2, 2, 2):
        share = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
        total = total + share * value[np.minimum(k % TURNS + c, TURNS - 1), i + a, j + b]
    return total
