"""Wrong solutions of the exercises that no rule of `mutants.py` makes, each with words that the
grader must say when it rejects it.

A function takes the place of that of the same name in its stage, and sees what stands there; `ours`,
the function that it replaces; and `mistake`, one of the lines above it.
"""
# ruff: noqa: F811, F821


def wrong(mistake, words):
    """A mark for the reader of this file, `referee.py`."""
    return lambda function: function


@wrong("takes away a single turn", "too few turns")
def wrap(angle):
    return angle - 2 * np.pi * np.clip(np.rint(angle / 2 / np.pi), -1, 1)


@wrong("wraps the yaw", "without wrap")
def compose(base, pose):
    pose = ours(base, pose)
    pose[..., 2] = wrap(pose[..., 2])
    return pose


@wrong("√(roll² + pitch²)", "roll 32°, pitch 32°")
@wrong("roll and pitch apart", "roll 35°, pitch 35°")
def fallen(torso, standing_height):
    roll, pitch = np.abs(torso[..., 3]), np.abs(torso[..., 4])
    tilt = np.hypot(roll, pitch) if "√" in mistake else np.maximum(roll, pitch)
    return (torso[..., 2] < standing_height / 2) | (tilt > np.pi / 4)


@wrong("a standard deviation for a variance", "so square them")
@wrong("every number for itself", "belong together")
def correct(goal, covariance, measured, noise):
    if mistake == "every number for itself":
        return ours(goal, covariance * np.eye(3), measured, noise)
    return ours(goal, covariance, measured, np.sqrt(noise))


@wrong("no bootstrap after a cut-off", "after a cut-off V(s') stays")
@wrong("V of the next row", "next_values[t]")
@wrong("normalised", "not normalised")
def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    if mistake == "no bootstrap after a cut-off":
        terminated = terminated | truncated
    elif mistake == "V of the next row":
        next_values = torch.cat([values[1:], next_values[-1:]])
    found = ours(rewards, values, next_values, terminated, truncated, gamma, lam)
    return found / found.std() if mistake == "normalised" else found


@wrong("gradients of any length", "as long as the gradient")
@wrong("zero_grad is forgotten", "zero_grad")
@wrong("actions of other samples", "still belong together")
@wrong("most samples are not used", "all 128 samples")
@wrong("never shuffled", "every epoch shuffles")
@wrong("π_old of every epoch", "π_old stay as they are given")
def improve(model, optimizer, data, cfg):
    from dataclasses import replace
    from unittest import mock

    if mistake == "gradients of any length":
        cfg = replace(cfg, max_grad_norm=1e9)
    elif mistake == "zero_grad is forgotten":
        optimizer.zero_grad = lambda: None
    elif mistake == "actions of other samples":
        data = data | {"action": data["action"].flip(0)}
    elif mistake == "most samples are not used":
        data = {name: values[:1] for name, values in data.items()}
    elif mistake == "never shuffled":
        with mock.patch("torch.randperm", torch.arange):
            return ours(model, optimizer, data, cfg)
    else:
        for _ in range(cfg.epochs - 1):
            ours(model, optimizer, data, replace(cfg, epochs=1))
            with torch.no_grad():
                data["log_prob"] = model.policy(data["obs"]).log_prob(data["action"])
        cfg = replace(cfg, epochs=1)
    return ours(model, optimizer, data, cfg)


@wrong("no width at 0 and 1", "Wald")
def wilson(count, total, z=1.96):
    p = count / total
    margin = z * math.sqrt(p * (1 - p) / total)
    return [p - margin, p + margin]


@wrong("two independent resamples", "paired")
def bootstrap(statistic, *samples, resamples=2000):
    rng, count = np.random.default_rng(0), len(samples[0])
    drawn = [sample[rng.integers(count, size=(resamples, count))] for sample in samples]
    return np.percentile(statistic(*drawn), [2.5, 97.5])


@wrong("no interpolation", "mean of the eight corners")
def look_up(value, poses):
    return ours(value, np.rint(poses / (CELL, CELL, TURN)) * (CELL, CELL, TURN))


@wrong("the yaw does not turn with the move", "V[yaw, x, y]")
@wrong("no interpolation between the yaws", "V = 1 + min over moves")
@wrong("moves turned by −yaw", "turned by −yaw")
@wrong("V[yaw, y, x]", "are x and y swapped")
@wrong("stops too early", "until nothing changes")
def steps_to_go(moves, task):
    if mistake == "the yaw does not turn with the move":
        moves = moves * [1, 1, 0]
    elif mistake == "no interpolation between the yaws":
        moves = np.column_stack([moves[:, :2], np.rint(moves[:, 2] / TURN) * TURN])
    value = ours(moves, task)
    if mistake == "moves turned by −yaw":
        return np.roll(value[::-1], 1, 0)
    if mistake == "stops too early":
        return np.where(value > 3, FAR, value)
    return value.swapaxes(1, 2) if mistake == "V[yaw, y, x]" else value


@wrong("by PyTorch", "write the formula")
def beta_entropy(alpha, beta):
    return torch.distributions.Beta(alpha, beta).entropy().sum(-1)
