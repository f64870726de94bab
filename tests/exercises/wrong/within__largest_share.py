# The largest share instead of the sum. Says: on the boundary

def within(footsteps, limits):
    largest = np.where(footsteps >= 0, limits.high, np.negative(limits.low))
    share = (np.abs(footsteps) / largest).max(-1, keepdims=True)
    return footsteps / np.maximum(1, share / limits.load)
