# Mirrors what the engine mirrors. Says: outward positive

def to_footsteps(action, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    asked = low + np.reshape(action, (*np.shape(action)[:-1], 2, 3)) * (high - low)
    return walk_engine.within(asked, limits) * walk_engine.MIRROR
