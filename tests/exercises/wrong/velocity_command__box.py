# Each axis is limited on its own. Says: a box

def velocity_command(goal, settings):
    d, alpha, beta = env.polar(goal)
    cos, sin = np.cos(beta), np.sin(beta)
    v_x = np.clip(settings.gain * d * cos, -settings.backward, settings.forward)
    v_y = np.clip(settings.gain * d * sin, -settings.sideways, settings.sideways)
    error = np.where(d > settings.far_m, beta, alpha)
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    return np.stack([v_x, v_y, omega], -1)
