# Angles from 0 to 2π. Says: [−π, π)

def wrap(angle):
    return angle % (2 * np.pi)
