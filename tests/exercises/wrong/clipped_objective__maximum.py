# The larger product. Says: take the minimum

def clipped_objective(ratio, advantage, clip):
    return torch.max(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)
