# One long Euler step. Says: exp(−t/τ)

def low_pass(velocity, command, seconds, time_constant):
    return velocity + min(1, seconds / max(time_constant, 1e-9)) * (command - velocity)
