# Takes away a single turn. Says: [−π, π)

def wrap(angle):
    return np.where(angle >= np.pi, angle - 2 * np.pi,
                    np.where(angle < -np.pi, angle + 2 * np.pi, angle))
