# Two independent resamples. Says: paired

def time_ratio(trials, reference, resamples=2000):
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]
    if not both.any():
        return None, None, 0
    pick, other = np.random.default_rng(0).integers(len(ours), size=(2, resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[other].mean(1)
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)
