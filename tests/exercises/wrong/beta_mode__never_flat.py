# A small number below. Says: loses the digits

def beta_mode(alpha, beta):
    return (alpha - 1) / ((alpha - 1) + (beta - 1) + 1e-6)
