# 0.5 is no step, as if the limits were symmetric. Says: 0.5 their middle

def to_footsteps(action, limits):
    high = np.array(limits.high)
    asked = (2 * np.reshape(action, (*np.shape(action)[:-1], 2, 3)) - 1) * high
    return walk_engine.within(asked, limits)
