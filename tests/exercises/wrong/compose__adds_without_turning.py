# The pose is not turned into the base's frame. Says: first turn the pose

def compose(base, pose):
    return base + pose
