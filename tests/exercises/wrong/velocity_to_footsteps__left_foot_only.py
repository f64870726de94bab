# The left foot steps inward, too. Says: one foot takes it all

def velocity_to_footsteps(velocity, period):
    v_x, v_y, omega = velocity.T
    half = period / 2
    footsteps = np.zeros((len(velocity), 2, 3))
    footsteps[:, :, 0] = (v_x * half)[:, None]
    footsteps[:, 0, 1] = v_y * period
    footsteps[:, 0, 2], footsteps[:, 1, 2] = omega * half, -omega * half
    return footsteps
