# Divides by the steps on the spot, too. Says: not on the spot

def highest_speed(poses, fall, period):
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])
        unbroken = np.cumprod(fall[rows] == len(PATTERN))
        speeds[direction] = float(np.max(moved * unbroken) / (len(PATTERN) * period))
    return speeds
