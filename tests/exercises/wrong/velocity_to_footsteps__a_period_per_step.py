# Each foot takes all of the way. Says: half the period's way

def velocity_to_footsteps(velocity, period):
    v_x, v_y, omega = velocity.T
    half = period / 2
    footsteps = np.zeros((len(velocity), 2, 3))
    footsteps[:, :, 0] = (v_x * period)[:, None]
    footsteps[:, 0, 1] = np.maximum(v_y, 0) * period
    footsteps[:, 1, 1] = np.maximum(-v_y, 0) * period
    footsteps[:, 0, 2], footsteps[:, 1, 2] = omega * half, -omega * half
    return footsteps
