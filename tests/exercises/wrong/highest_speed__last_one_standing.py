# The last level that stood instead of the fastest one. Says: not the last one that stood

def highest_speed(poses, fall, period):
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])
        unbroken = np.cumprod(fall[rows] == len(PATTERN))
        last = unbroken.sum() - 1
        way = moved[last] if last >= 0 else 0.0
        speeds[direction] = float(way / (sum(PATTERN) * period))
    return speeds
