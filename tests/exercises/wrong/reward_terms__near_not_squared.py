# exp(−d²/0.4) instead of exp(−(d/0.4)²). Says: near(d) = exp(−(d / 0.4 m)²)

def reward_terms(before, after, action, last_action, fall, success, task=Task()):
    d0, alpha0, beta0 = polar(before)
    d1, alpha1, beta1 = polar(after)
    near0, near1 = np.exp(-(d0**2) / task.near_m), np.exp(-(d1**2) / task.near_m)
    distance = d0 - d1
    angle = np.abs(alpha0) * near0 - np.abs(alpha1) * near1
    orient = np.abs(beta0) * (1 - near0) - np.abs(beta1) * (1 - near1)
    x_and_y = [0, 1, 3, 4]
    continuity = -((action - last_action)[:, x_and_y] ** 2).sum(-1)
    return {"r_d": task.s_d * distance, "r_a": task.s_a * angle, "r_o": task.s_o * orient,
            "r_c": task.s_c * continuity, "r_fall": -task.s_fall * fall,
            "r_goal": task.s_goal * success, "r_time": np.full(len(d0), -task.s_time)}
