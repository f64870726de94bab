# One limit for both signs. Says: forward and backward

def within(footsteps, limits):
    share = (np.abs(footsteps) / limits.high).sum(-1, keepdims=True)
    return footsteps / np.maximum(1, share / limits.load)
