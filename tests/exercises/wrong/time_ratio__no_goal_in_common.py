# The mean of nothing. Says: no ratio

def time_ratio(trials, reference, resamples=2000):
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]
    if not both.any():
        return math.nan, [math.nan, math.nan], 0
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)
