# The mean. Says: would be the mean

def beta_mode(alpha, beta):
    return alpha / (alpha + beta)
