"""Exercise: the Beta distribution of stage 4 by hand. PyTorch's own is what grades it.

α, β > 0 are tensors [..., k], one pair for each of k independent variables x in [0, 1].
"""

import torch


def log_beta_function(alpha, beta):
    """Logarithm of the Beta function, which norms the density; elementwise."""
    # ln B(α, β) = ln Γ(α) + ln Γ(β) − ln Γ(α + β)
    return torch.lgamma(alpha) + torch.lgamma(beta) - torch.lgamma(alpha + beta)


def beta_log_prob(x, alpha, beta):
    """Log-density of k independent variables, [..., k] -> [...]."""
    # ln p(x) = (α−1)·ln x + (β−1)·ln(1−x) − ln B(α, β), summed over the variables
    log_p = (alpha - 1) * torch.log(x) + (beta - 1) * torch.log1p(-x)
    return (log_p - log_beta_function(alpha, beta)).sum(-1)


def beta_mode(alpha, beta):
    """The maximum of the density for α, β ≥ 1; 0.5 where it is flat (α = β = 1: 0/0)."""
    # mode = (α − 1) / (α + β − 2)
    left, right = alpha - 1, beta - 1
    flat = left + right == 0
    return torch.where(flat, torch.full_like(left, 0.5), left / (left + right + flat))


def beta_entropy(alpha, beta):
    """[..., k] -> [...] [nats]; 0 for the uniform distribution."""
    # H = ln B(α, β) − (α−1)·ψ(α) − (β−1)·ψ(β) + (α+β−2)·ψ(α+β),  ψ: digamma
    psi = torch.digamma
    each = (
        log_beta_function(alpha, beta)
        - (alpha - 1) * psi(alpha)
        - (beta - 1) * psi(beta)
        + (alpha + beta - 2) * psi(alpha + beta)
    )
    return each.sum(-1)
