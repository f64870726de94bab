# Nothing was written. Says: write the formula

def beta_entropy(alpha, beta):
    return torch.distributions.Beta(alpha, beta).entropy().sum(-1)
