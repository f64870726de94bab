# For a single pose, not for a batch. Says: too many values

def compose(base, pose):
    x, y, yaw = base
    dx, dy = turned(pose[:2], yaw)
    return np.array([x + dx, y + dy, yaw + pose[2]])
