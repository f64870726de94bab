# Too much is not made smaller. Says: is `within` missing?

def to_footsteps(action, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    asked = low + np.reshape(action, (*np.shape(action)[:-1], 2, 3)) * (high - low)
    return asked
