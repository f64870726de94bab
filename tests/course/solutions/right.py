"""Right solutions of the exercises in other ways than ours, where several are common; the grader must
accept each of them.

A function takes the place of that of the same name in its stage, as those of `wrong.py` do.
"""
# ruff: noqa: F811, F821


def wrap(angle):
    """By arctan2, in (−π, π]."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def compose(base, pose):
    """Adds and overwrites the place."""
    total = base + pose
    total[..., :2] = base[..., :2] + turned(pose[..., :2], base[..., 2])
    return total


def fallen(torso, standing_height):
    """The angle itself."""
    roll, pitch = torso[..., 3], torso[..., 4]
    tilt = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1))
    return np.logical_or(torso[..., 2] < standing_height / 2, np.degrees(tilt) > 45)


def waiting_pace(over, p):
    """By cases."""
    pace = 1 + p.wait * p.late_lean - p.wait * np.asarray(over)
    return np.select([pace > 1, pace < 0], [1.0, 0.0], pace)


def reflex(error, swings, p):
    """Row by row, in single precision."""
    added = np.zeros((len(error), 12), np.float32)
    for row, rate, own in zip(added, error, swings):
        for foot in np.flatnonzero(~own):  # that stands
            row[6 * foot + 5], row[6 * foot + 4] = p.reflex * rate
    return np.clip(added, -REFLEX_LIMIT, REFLEX_LIMIT)


def quintic(start, end, duration):
    """Six equations."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    rows = []
    for t in (0.0, duration):
        rows.append([t**k for k in range(6)])
        rows.append([k * t ** max(k - 1, 0) for k in range(6)])
        rows.append([k * (k - 1) * t ** max(k - 2, 0) for k in range(6)])
    known = np.concatenate([start, end], -1)
    return np.linalg.solve(np.array(rows), known[..., None])[..., 0]


def _swing(self, start, landing):
    """Tick by tick, by the share of the way."""
    p, foot = self.parameters, np.zeros((len(start), self.parameters.step_ticks + 1, 4))
    for k in range(p.step_ticks + 1):
        tau = max(0, k / p.step_ticks - p.double_support) / (1 - p.double_support)
        share = tau**3 * (10 - 15 * tau + 6 * tau**2)
        foot[:, k, [0, 1, 3]] = start + share * (landing - start)
        up = 2 * min(tau, 1 - tau)
        foot[:, k, 2] = p.foot_rise * (10 * up**3 - 15 * up**4 + 6 * up**5)
    return foot


def potentials(goal, near_m):
    """Term by term, without stack."""
    d, alpha, beta = polar(goal)
    near = np.exp(-((d / near_m) ** 2))
    phi = np.zeros((3, len(goal)))
    phi[0], phi[1] = -d, -abs(alpha) * near
    phi[2] = -abs(beta) * (1 - near)
    return phi


def correct(goal, covariance, measured, noise):
    """(1 − K)·P as it is written, robot by robot, by a linear system."""
    goal, covariance = goal.copy(), covariance.copy()
    for i, P in enumerate(covariance):
        gain = np.linalg.solve(P + np.diag(noise**2), P).T
        error = measured[i] - goal[i]
        error[2] = wrap(error[2])
        goal[i] += gain @ error
        covariance[i] = (np.eye(3) - gain) @ P
    goal[:, 2] = wrap(goal[:, 2])
    return goal, covariance


def clipped_objective(ratio, advantage, clip):
    """By cases."""
    good = ratio.clamp(max=1 + clip) * advantage
    bad = ratio.clamp(min=1 - clip) * advantage
    return torch.where(advantage > 0, good, bad)


def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """1 − done, as most write it."""
    done = (terminated | truncated).float()
    next_values = torch.nan_to_num(next_values)
    deltas = rewards + gamma * next_values * (1.0 - terminated.float()) - values
    advantages, last = torch.zeros_like(rewards), 0.0
    for t in reversed(range(rewards.shape[0])):
        last = deltas[t] + gamma * lam * (1.0 - done[t]) * last
        advantages[t] = last
    return advantages


def low_pass(velocity, command, seconds, time_constant):
    """By expm1."""
    return velocity - math.expm1(-seconds / max(time_constant, 1e-06)) * (command - velocity)


def wilson(count, total, z=1.96):
    """Counts instead of rates, by NumPy."""
    middle = (count + z**2 / 2) / (total + z**2)
    width = z * np.sqrt(count * (total - count) / total + z**2 / 4) / (total + z**2)
    return tuple(np.clip([middle - width, middle + width], 0, 1))


def velocity_command(goal, settings):
    """Shrinks what is too fast."""
    v = settings.gain * goal[:, :2]
    limit = np.where(v[:, 0] < 0, settings.backward, settings.forward)
    used = np.abs(v[:, 0]) / limit + np.abs(v[:, 1]) / settings.sideways
    v = v / np.maximum(used, 1)[:, None]
    d, alpha, beta = env.polar(goal)
    omega = settings.turning_gain * np.where(d <= settings.far_m, alpha, beta)
    omega = np.minimum(np.maximum(omega, -settings.turning), settings.turning)
    return np.column_stack([v, omega])


def velocity_to_footsteps(velocity, period, lead=(1, 0.5)):
    """The leading foot by its index."""
    n, leads = len(velocity), (velocity[:, 1:] < 0).astype(int)
    way = np.abs(velocity[:, 1:]) * period
    steps = np.empty((n, 2, 3))
    steps[:, :, 0] = (velocity[:, 0] * period / 2)[:, None]
    for foot in (0, 1):
        steps[:, foot, 1:] = np.where(leads == foot, way * lead, way * lead - way)
    return steps


def bootstrap(statistic, *samples, resamples=2000):
    """One resample at a time."""
    n = len(samples[0])
    rng, found = np.random.default_rng(7), []
    for _ in range(resamples):
        pick = rng.choice(n, (1, n))
        found.extend(statistic(*(np.take(sample, pick) for sample in samples)))
    return np.quantile(found, 0.025), np.quantile(found, 0.975)


def beta_entropy(alpha, beta):
    """With E[ln x] and E[ln(1 − x)]."""
    both = torch.digamma(alpha + beta)
    ln_x, ln_rest = torch.digamma(alpha) - both, torch.digamma(beta) - both
    mean = (alpha - 1) * ln_x + (beta - 1) * ln_rest - log_beta_function(alpha, beta)
    return -mean.sum(-1)
