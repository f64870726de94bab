# The yaw as given, 350° to the left. Says: 10° to the right

def velocity_command(goal, settings):
    d, alpha, beta = env.polar(goal)
    cos, sin = np.cos(beta), np.sin(beta)
    x_max = np.where(cos >= 0, settings.forward, settings.backward)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / settings.sideways)
    v = np.minimum(settings.gain * d, v_max)
    error = np.where(d > settings.far_m, beta, goal[:, 2])
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    return np.stack([v * cos, v * sin, omega], -1)
