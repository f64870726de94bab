# A sum over both feet. Says: does not shrink the other one's

def within(footsteps, limits):
    largest = np.where(footsteps >= 0, limits.high, np.negative(limits.low))
    share = (np.abs(footsteps) / largest).sum((-1, -2), keepdims=True)
    return footsteps / np.maximum(1, share / limits.load)
