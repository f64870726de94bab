# Each axis is cut at half its limit. Says: untouched

def within(footsteps, limits):
    share = limits.load / 3
    return np.clip(footsteps, share * np.array(limits.low), share * np.array(limits.high))
