# π stays π: (−π, π]. Says: π becomes −π

def wrap(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))
