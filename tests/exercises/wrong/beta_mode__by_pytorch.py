# Nothing was written. Says: write the formula

def beta_mode(alpha, beta):
    flat = alpha + beta == 2
    return torch.where(flat, 0.5, torch.distributions.Beta(alpha, beta).mode)
