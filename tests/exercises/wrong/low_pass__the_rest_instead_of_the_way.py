# exp(−t/τ) is what is left of the way. Says: exp(−t/τ)

def low_pass(velocity, command, seconds, time_constant):
    return velocity + math.exp(-seconds / max(time_constant, 1e-9)) * (command - velocity)
