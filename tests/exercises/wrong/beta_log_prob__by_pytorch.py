# Nothing was written. Says: write the formula

def beta_log_prob(x, alpha, beta):
    return torch.distributions.Beta(alpha, beta).log_prob(x).sum(-1)
