# α and β exchanged. Says: α is not β

def encode_goal(goal):
    d, beta, alpha = polar(goal)
    x, y = np.clip(2 * goal[..., 0], -1, 1), np.clip(2 * goal[..., 1], -1, 1)
    return np.stack([np.minimum(d, 3.0), x, y, np.cos(beta), np.sin(beta),
                     np.cos(alpha), np.sin(alpha), alpha / np.pi], -1)
