# Far goals beyond the bounds. Says: clipped

def encode_goal(goal):
    d, alpha, beta = polar(goal)
    x, y = 2 * goal[..., 0], 2 * goal[..., 1]
    return np.stack([np.minimum(d, 3.0), x, y, np.cos(beta), np.sin(beta),
                     np.cos(alpha), np.sin(alpha), alpha / np.pi], -1)
