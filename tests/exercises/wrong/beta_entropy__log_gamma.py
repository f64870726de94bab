# ln Γ instead of ψ. Says: DIgamma

def beta_entropy(alpha, beta):
    psi = torch.lgamma
    each = (log_beta_function(alpha, beta) - (alpha - 1) * psi(alpha) - (beta - 1) * psi(beta)
            + (alpha + beta - 2) * psi(alpha + beta))
    return each.sum(-1)
