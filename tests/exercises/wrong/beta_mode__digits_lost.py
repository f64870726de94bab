# α + β − 2 loses digits, and 0/0 is nan. Says: loses the digits

def beta_mode(alpha, beta):
    return (alpha - 1) / (alpha + beta - 2)
