# No minimum. Says: take the minimum

def clipped_objective(ratio, advantage, clip):
    return ratio.clamp(1.0 - clip, 1.0 + clip) * advantage
