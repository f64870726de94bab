# Counts the times of falls. Says: a fall's time

def time_ratio(trials, reference, resamples=2000):
    both = reference["outcome"] == "success"
    ours, theirs = trials["time"][both], reference["time"][both]
    if not both.any():
        return None, None, 0
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)
