# One number for all rows. Says: SUM over axis −1

def beta_log_prob(x, alpha, beta):
    log_p = (alpha - 1) * torch.log(x) + (beta - 1) * torch.log1p(-x)
    return (log_p - log_beta_function(alpha, beta)).sum()
