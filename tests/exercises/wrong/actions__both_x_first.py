# Sorted by axis, not by foot. Says: first the left foot

def to_footsteps(action, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    asked = low + np.reshape(action, (*np.shape(action)[:-1], 3, 2)).swapaxes(-1, -2) * (high - low)
    return walk_engine.within(asked, limits)

def to_action(footsteps, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    share = np.clip((footsteps - low) / (high - low), 0, 1)
    return share.swapaxes(-1, -2).reshape(*share.shape[:-2], 6)
