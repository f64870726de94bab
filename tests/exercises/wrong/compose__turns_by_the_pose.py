# Turned by the pose's own yaw. Says: turn the pose by the base's yaw

def compose(base, pose):
    place = base[..., :2] + turned(pose[..., :2], pose[..., 2])
    return np.concatenate([place, (base[..., 2] + pose[..., 2])[..., None]], -1)
