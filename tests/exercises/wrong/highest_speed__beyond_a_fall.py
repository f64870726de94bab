# A fast level counts although a slower one fell. Says: below the first one that fell

def highest_speed(poses, fall, period):
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])
        unbroken = fall[rows] == len(PATTERN)
        speeds[direction] = float(np.max(moved * unbroken) / (sum(PATTERN) * period))
    return speeds
