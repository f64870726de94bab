# The sign. Says: is the sign right

def low_pass(velocity, command, seconds, time_constant):
    return velocity + (1 - math.exp(-seconds / max(time_constant, 1e-9))) * (velocity - command)
