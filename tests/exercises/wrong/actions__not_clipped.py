# Actions outside of [0, 1]. Says: clipped to [0, 1]

def to_action(footsteps, limits):
    low, high = np.array(limits.low), np.array(limits.high)
    share = (footsteps - low) / (high - low)
    return share.reshape(*share.shape[:-2], 6)
