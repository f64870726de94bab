# To be minimised. Says: a minus too many

def clipped_objective(ratio, advantage, clip):
    return -torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)
