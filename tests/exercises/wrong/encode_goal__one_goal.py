# For a single goal. Says: goals [..., 3] -> [..., 8]

def encode_goal(goal):
    x, y, yaw = np.ravel(goal)[:3]
    d, alpha, beta = math.hypot(x, y), wrap(yaw), math.atan2(y, x)
    return np.array([min(d, 3.0), max(-1, min(1, 2 * x)), max(-1, min(1, 2 * y)), math.cos(beta),
                     math.sin(beta), math.cos(alpha), math.sin(alpha), alpha / math.pi])
