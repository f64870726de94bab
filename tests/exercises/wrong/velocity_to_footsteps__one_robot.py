# The first robot's speed for all. Says: robots must not influence

def velocity_to_footsteps(velocity, period):
    v_x, v_y, omega = velocity[:1].T
    half = period / 2
    footsteps = np.zeros((len(velocity), 2, 3))
    footsteps[:, :, 0] = (v_x * half)[:, None]
    footsteps[:, 0, 1] = np.maximum(v_y, 0) * period
    footsteps[:, 1, 1] = np.maximum(-v_y, 0) * period
    footsteps[:, 0, 2], footsteps[:, 1, 2] = omega * half, -omega * half
    return footsteps
