# α and β exchanged. Says: in their places

def beta_log_prob(x, alpha, beta):
    log_p = (beta - 1) * torch.log(x) + (alpha - 1) * torch.log1p(-x)
    return (log_p - log_beta_function(alpha, beta)).sum(-1)
