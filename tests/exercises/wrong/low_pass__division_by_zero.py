# τ = 0 means no filter. Says: division by zero

def low_pass(velocity, command, seconds, time_constant):
    return velocity + (1 - math.exp(-seconds / time_constant)) * (command - velocity)
