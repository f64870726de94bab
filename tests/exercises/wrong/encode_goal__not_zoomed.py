# x and y in metres. Says: 2d·cos β

def encode_goal(goal):
    d, alpha, beta = polar(goal)
    x, y = np.clip(goal[..., 0], -1, 1), np.clip(goal[..., 1], -1, 1)
    return np.stack([np.minimum(d, 3.0), x, y, np.cos(beta), np.sin(beta),
                     np.cos(alpha), np.sin(alpha), alpha / np.pi], -1)
