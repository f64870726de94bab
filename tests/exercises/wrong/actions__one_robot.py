# A single action. Says: actions [..., 6], any [...]

def to_footsteps(action, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    return walk_engine.within(low + np.reshape(action, (-1, 2, 3)) * (high - low), limits)
