# Clips at 1 + ε only. Says: take the minimum

def clipped_objective(ratio, advantage, clip):
    return torch.min(ratio, torch.full_like(ratio, 1.0 + clip)) * advantage
