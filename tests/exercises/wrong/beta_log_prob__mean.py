# The mean over the variables. Says: SUM

def beta_log_prob(x, alpha, beta):
    log_p = (alpha - 1) * torch.log(x) + (beta - 1) * torch.log1p(-x)
    return (log_p - log_beta_function(alpha, beta)).mean(-1)
