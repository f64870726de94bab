# One number instead of one per sample. Says: per sample

def clipped_objective(ratio, advantage, clip):
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage).mean()
