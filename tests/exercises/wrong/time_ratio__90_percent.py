# 5 and 95 %. Says: 2.5 and 97.5 %

def time_ratio(trials, reference, resamples=2000):
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]
    if not both.any():
        return None, None, 0
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)
    return ours.mean() / theirs.mean(), np.percentile(ratios, [5, 95]), len(ours)
