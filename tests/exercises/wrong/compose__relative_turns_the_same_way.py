# relative turns by +yaw. Says: turn back, by −yaw

def relative(base, pose):
    place = turned(pose[..., :2] - base[..., :2], base[..., 2])
    return np.concatenate([place, (pose[..., 2] - base[..., 2])[..., None]], -1)
