# relative turns before it subtracts. Says: subtract the base's place

def relative(base, pose):
    place = turned(pose[..., :2], -base[..., 2]) - base[..., :2]
    return np.concatenate([place, (pose[..., 2] - base[..., 2])[..., None]], -1)
