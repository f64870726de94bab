# − instead of +. Says: every sign

def beta_entropy(alpha, beta):
    psi = torch.digamma
    each = (log_beta_function(alpha, beta) - (alpha - 1) * psi(alpha) - (beta - 1) * psi(beta)
            - (alpha + beta - 2) * psi(alpha + beta))
    return each.sum(-1)
