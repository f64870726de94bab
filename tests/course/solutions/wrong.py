"""Wrong solutions of the exercises that no rule of `mutants.py` makes, each with words that the
grader must say when it rejects it; and right ones that differ from a wrong one in a line or two.

A function takes the place of that of the same name in its stage, and sees what stands there; and
`mistake`, one of the lines above it. (All of `improve` and `steps_to_go` are here: they train and
search, with a mistake by rule perhaps for minutes.)
"""
# ruff: noqa: F811, F821


def wrong(mistake, words):
    """A mark for the reader of this file, `referee.py`."""
    return lambda function: function


def right(mistake):
    """The same for a way that the grader must accept: it is no mistake."""
    return lambda function: function


# ------------------------------------------------------------------------ stage 1
@right("by arctan2, in (−π, π]")
@wrong("in degrees", "too few turns")
@wrong("a remainder with the sign of the angle", "too few turns")
@wrong("takes away a single turn", "too few turns")
def wrap(angle):
    if mistake == "in degrees":
        return (angle + 180) % 360 - 180
    if mistake == "a remainder with the sign of the angle":
        return np.fmod(angle + np.pi, 2 * np.pi) - np.pi
    if mistake != "takes away a single turn":
        return np.arctan2(np.sin(angle), np.cos(angle))
    return angle - 2 * np.pi * np.clip(np.floor(angle / 2 / np.pi + 0.5), -1, 1)


@wrong("wraps the yaw", "without wrap")
@wrong("one pose, no batch", "batches [n, …]")
@wrong("a yaw without an axis", "[..., None]")
@wrong("turns the other way", "first turn the pose")
def compose(base, pose):
    if mistake == "one pose, no batch":
        x, y, yaw = base
        return np.array([*(base[:2] + turned(pose[:2], yaw)), yaw + pose[2]])
    if mistake == "turns the other way":
        base = base * [1, 1, -1]
    place = base[..., :2] + turned(pose[..., :2], base[..., 2])
    if mistake == "a yaw without an axis":
        return np.concatenate([place, base[..., 2] + pose[..., 2]], -1)
    return np.concatenate([place, wrap(base[..., 2:] + pose[..., 2:])], -1)


@wrong("wraps the yaw", "relative subtracts yaws, without wrap")
def relative(base, pose):
    away = pose - base
    place = turned(away[..., :2], -base[..., 2])
    return np.concatenate([place, wrap(away[..., 2:])], -1)


@wrong("√(roll² + pitch²)", "roll 32°, pitch 32°")
@wrong("roll and pitch apart", "roll 35°, pitch 35°")
@wrong("roll and pitch added up", "roll 32°, pitch 32°")
@wrong("0.2 m by heart", "of 0.6 m")
@wrong("or", "batches [n, …]")
def fallen(torso, standing_height):
    roll, pitch = np.moveaxis(torso[..., 3:5], -1, 0)
    tilted = {
        "√(roll² + pitch²)": np.hypot(roll, pitch) > np.pi / 4,
        "roll and pitch apart": np.maximum(np.abs(roll), np.abs(pitch)) > np.pi / 4,
        "roll and pitch added up": np.cos(roll + pitch) < np.cos(np.pi / 4),
    }.get(mistake, np.cos(roll) * np.cos(pitch) < np.cos(np.pi / 4))
    low = torso[..., 2] < (0.2 if mistake == "0.2 m by heart" else standing_height / 2)
    return (low or tilted) if mistake == "or" else low | tilted


@right("link by link along each chain")
@wrong("R turned round", "the torso: its rotation is wrong (it is transposed)")
@wrong("roll before yaw", "the left hip: its rotation")
@wrong("hip_x is forgotten", "the left thigh: its origin")
def link_frames(robot, torso, joints):
    origins, turns = [torso[..., :3]], [rotation(*np.moveaxis(torso[..., 3:], -1, 0))]
    if mistake == "R turned round":
        turns = [turns[0].mT]
    angles, zero = np.moveaxis(joints, -1, 0), 0 * joints[..., 0]
    ahead = 0 if mistake == "hip_x is forgotten" else robot.hip_x
    for hip, leg in zip(robot.hips, (angles[:6], angles[6:])):
        yaw, roll, pitch, knee, ankle_pitch, ankle_roll = leg
        turn = rotation(zero, zero, yaw) @ rotation(roll, zero, zero)
        if mistake == "roll before yaw":
            turn = rotation(roll, zero, zero) @ rotation(zero, zero, yaw)
        chain = {
            (*hip,): turn,
            (ahead, 0, 0): rotation(zero, pitch, zero),
            (0, 0, -robot.thigh_length): rotation(zero, knee, zero),
            (0, 0, -robot.shin_length): rotation(ankle_roll, ankle_pitch, zero),
        }
        place, turn = origins[0], turns[0]
        for away, further in chain.items():
            place, turn = place + turn @ away, turn @ further
            origins.append(place)
            turns.append(turn)
    return np.stack(origins, -2), np.stack(turns, -3)


# ------------------------------------------------------------------------ stage 2
@right("by einsum")
@wrong("the foot that swings", "which foot?")
@wrong("roll and pitch exchanged", "which axis?")
@wrong("turns back", "which sign?")
@wrong("limits the error", "how much?")
def reflex(error, swings, p):
    if mistake == "limits the error":
        error = np.clip(error, -REFLEX_LIMIT, REFLEX_LIMIT)
    gain = -p.reflex if mistake == "turns back" else p.reflex
    turn = np.clip(gain * error, -REFLEX_LIMIT, REFLEX_LIMIT)
    feet = swings if mistake == "the foot that swings" else 1.0 - swings
    added = np.zeros((*swings.shape, 6))
    ankle = [4, 5] if mistake == "roll and pitch exchanged" else [5, 4]
    added[..., ankle] = np.einsum("nf,na->nfa", feet, turn)
    return added.reshape(len(error), 12)


@right("tick by tick")
@wrong("moves by a cubic", "without acceleration")
def _swing(self, start, landing):
    p, foot = self.parameters, np.zeros((len(start), self.parameters.step_ticks + 1, 4))
    for k in range(p.step_ticks + 1):
        tau = max(0, k / p.step_ticks - p.double_support) / (1 - p.double_support)
        share = tau**3 * (10 - 15 * tau + 6 * tau**2)
        if mistake == "moves by a cubic":
            share = 3 * tau**2 - 2 * tau**3
        foot[:, k, [0, 1, 3]] = start + share * (landing - start)
        up = 2 * min(tau, 1 - tau)
        foot[:, k, 2] = p.foot_rise * (10 * up**3 - 15 * up**4 + 6 * up**5)
    return foot


# ------------------------------------------------------------------------ stage 3
@right("x and y by d and β")
@wrong("the yaw as it is given", "wrap the angle")
def encode_goal(goal):
    d, alpha, beta = polar(goal)
    turns = np.cos(beta), np.sin(beta), np.cos(alpha), np.sin(alpha)
    place = [np.clip(2 * d * turn, -1, 1) for turn in turns[:2]]
    yaw = goal[..., 2] if mistake == "the yaw as it is given" else alpha
    return np.stack([np.minimum(d, 2), *place, *turns, yaw / np.pi], -1)


@right("in single precision, as the policy's are")
@wrong("sorted by axis, not by foot", "first the left foot")
@wrong("for one robot, no batch", "actions [..., 6], any [...]")
def to_footsteps(action, limits):
    batch = (-1,) if mistake == "for one robot, no batch" else np.shape(action)[:-1]
    share = np.reshape(action, (*batch, 2, 3)).astype(np.float32)
    if mistake == "sorted by axis, not by foot":
        share = np.reshape(action, (*batch, 3, 2)).swapaxes(-1, -2)
    return limits.low + share * np.subtract(limits.high, limits.low)


@right("(1 − K)·P as it is written, robot by robot, by a linear system")
@wrong("every number for itself", "belong together")
@wrong("a standard deviation for a variance", "so square them")
@wrong("goal − measured", "a sign is turned round")
@wrong("R / (V + R)", "K = V / (V + R) is turned round")
@wrong("half of both", "the plain mean")
@wrong("the error is not wrapped", "wrap the error of yaw: from 3.1")
@wrong("the result is not wrapped", "wrap the yaw of the result, too")
@wrong("for one robot, no batch", "batches [n, …]")
@wrong("with variances only, for one robot", "batches [n, …]")
def correct(goal, covariance, measured, noise):
    if "one robot" in mistake:
        P, R, error = covariance, np.diag(np.square(noise)), measured - goal
        if "variances" in mistake:
            P = np.diag(np.diag(covariance))
        gain = P @ np.linalg.inv(P + R)
        return goal + gain @ error, gain @ R
    goal, covariance = goal.copy(), covariance.copy()
    for i, P in enumerate(covariance):
        if mistake == "every number for itself":
            P = P * np.eye(3)
        R = np.diag(noise if mistake == "a standard deviation for a variance" else noise**2)
        gain = np.linalg.solve(P + R, P).T
        if mistake == "half of both":
            gain = np.eye(3) / 2
        error = measured[i] - goal[i]
        if mistake != "the error is not wrapped":
            error[2] = wrap(error[2])
        if mistake == "goal − measured":
            error = -error
        goal[i] += (np.eye(3) - gain if mistake == "R / (V + R)" else gain) @ error
        covariance[i] = (np.eye(3) - gain) @ P
    if mistake != "the result is not wrapped":
        goal[:, 2] = wrap(goal[:, 2])
    return goal, covariance


@wrong("a standard deviation for a variance", "so square them")
@wrong("not turned", "J·P·Jᵀ, J = Rz(−turn)")
@wrong("turned the wrong way", "J·P·Jᵀ, J = Rz(−turn)")
@wrong("all turned by the yaw of the first one", "its OWN turn")
@wrong("adds before it turns", "then add G·D·Gᵀ")
@wrong("for one robot, no batch", "batches [n, …]")
def predict(goal, covariance, motion, drift):
    turn = motion[2] if mistake == "for one robot, no batch" else motion[:, 2]
    if mistake == "all turned by the yaw of the first one":
        turn = motion[0, 2]
    turn = turn * {"not turned": 0, "turned the wrong way": -1}.get(mistake, 1)
    goal = robot_model.relative(motion, goal)
    J = robot_model.rotation(0, 0, -turn)
    G = np.tile(np.eye(3), (len(goal), 1, 1))
    G[:, 0, 2], G[:, 1, 2] = -goal[:, 1], goal[:, 0]
    D = np.diag(drift if mistake == "a standard deviation for a variance" else drift**2)
    added = G @ D @ G.mT
    if mistake == "adds before it turns":
        return goal, J @ (covariance + added) @ J.mT
    return goal, J @ covariance @ J.mT + added


# ------------------------------------------------------------------------ stage 4
@right("the smallest of a stack")
@wrong("to be minimised", "a minus too many")
@wrong("clips the product", "take the minimum")
@wrong("clips the advantage", "take the minimum")
@wrong("always 0.2", "ε is the argument")
@wrong("one number instead of one per sample", "per sample")
@wrong("through NumPy, without a gradient", "gradient")
@wrong("a gradient beyond the limit", "beyond 1 + ε")
def clipped_objective(ratio, advantage, clip):
    if mistake == "always 0.2":
        clip = 0.2
    low, high, plain = 1 - clip, 1 + clip, ratio * advantage
    least = torch.stack([plain, ratio.clamp(low, high) * advantage]).min(0).values
    return {
        "to be minimised": -least,
        "clips the product": plain.clamp(low, high),
        "clips the advantage": torch.min(plain, ratio * advantage.clamp(low, high)),
        "one number instead of one per sample": least.mean(),
        "through NumPy, without a gradient": least.detach(),
        "a gradient beyond the limit": least.detach() + plain - plain.detach(),
    }.get(mistake, least)


@right("another clamp")
@right("by NumPy, ln(m / (1 − m)) and w + ln(1 − exp(−w))")
@wrong("m, c, m, c", "all variables, then")
@wrong("c instead of c − 2", "c−2")
@wrong("the mode itself instead of its logit", "logit")
@wrong("of the critic", "doesn't match")
def __init__(self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0):
    super().__init__()
    self.shape = {"obs_dim": obs_dim, "act_dim": act_dim, "hidden": hidden}
    self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
    self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
    least = 0.001 if mistake == "another clamp" else 0.01
    mode = (
        torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(least, 1 - least)
    )
    narrow = torch.full((act_dim,), float(concentration))
    if mistake != "c instead of c − 2":
        narrow -= 2
    place, width = torch.logit(mode), torch.log(torch.expm1(narrow))
    if mistake == "the mode itself instead of its logit":
        place = mode
    elif mistake == "by NumPy, ln(m / (1 − m)) and w + ln(1 − exp(−w))":
        m, w = mode.numpy(), narrow.numpy()
        place, width = map(torch.tensor, (np.log(m / (1 - m)), w + np.log1p(-np.exp(-w))))
    bias = torch.cat([place, width])
    if mistake == "m, c, m, c":
        bias = torch.stack([place, width], -1).flatten()
    network = self.critic if mistake == "of the critic" else self.actor
    network[-1].bias.data.copy_(bias)


@right("a list that is turned round")
@wrong("no bootstrap after a cut-off", "after a cut-off V(s') stays")
@wrong("the flags of the row before", "after a fall V(s') counts as 0")
@wrong("0·nan", "0·nan is nan")
@wrong("V of the next row", "next_values[t]")
@wrong("normalised", "not normalised")
@wrong("by NumPy", "write it in PyTorch")
@wrong("for one robot, no batch", "batches [n, …]")
def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    if mistake == "the flags of the row before":
        terminated, truncated = terminated.roll(1, 0), truncated.roll(1, 0)
    if mistake == "V of the next row":
        next_values = torch.cat([values[1:], next_values[-1:]])
    done = terminated | truncated
    over = done if mistake == "no bootstrap after a cut-off" else terminated
    after = next_values * ~over if mistake == "0·nan" else next_values.masked_fill(over, 0)
    deltas = rewards + gamma * after - values
    found = [torch.zeros_like(rewards[0])]
    for delta, end in zip(deltas.flip(0), done.flip(0)):
        if mistake == "for one robot, no batch" and end:
            found[-1] = 0
        found.append(delta + gamma * lam * found[-1] * ~end)
    advantages = torch.stack(found[:0:-1])
    if mistake == "by NumPy":
        return advantages.numpy()
    if mistake == "normalised":
        return (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)
    return advantages


@right("numbers to watch by their definitions")
@right("shuffled by NumPy")
@wrong("no normalisation", "divide by std")
@wrong("normalised once, over all samples", "over the MINIBATCH")
@wrong("no c_V", "value_coef")
@wrong("the sign of the objective", "the sign of the objective is wrong")
@wrong("gradients of any length", "as long as the gradient")
@wrong("limits the actor's gradient only", "actor and critic together")
@wrong("zero_grad is forgotten", "zero_grad")
@wrong("judges in every epoch", "targets and π_old stay as they are given")
@wrong("a KL with much noise", "KL, clip fraction")
@wrong("actions of other samples", "still belong together")
@wrong("π_old in the order of the rollout", "of the same `pick`")
@wrong("ρ is always 1", "π_old")
@wrong("most samples are not used", "all 128 samples")
@wrong("the last, smaller minibatch is dropped", "all 128 samples")
@wrong("half the squared error", "without a half")
@wrong("never shuffled", "every epoch shuffles")
@wrong("shuffled once", "every epoch shuffles")
@wrong("the entropy after the update", "entropy")
def improve(model, optimizer, data, cfg):
    obs, action, old_log_prob, advantages, targets = (
        data[name].flatten(0, 1) for name in ("obs", "action", "log_prob", "advantage", "target")
    )
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean().item()
        unexplained = np.var((targets - model.value(obs)).numpy()) / np.var(targets.numpy())
    once = torch.randperm(len(obs))
    if mistake == "normalised once, over all samples":
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    for _ in range(cfg.epochs):
        if mistake == "judges in every epoch":
            judged = judge(model, data, cfg)
            advantages, targets = (values.flatten() for values in judged)
            old_log_prob = model.policy(obs).log_prob(action).detach()
        order = torch.randperm(len(obs))
        if mistake == "shuffled by NumPy":
            order = torch.from_numpy(np.random.permutation(len(obs)))
        order = {"never shuffled": order.sort()[0], "shuffled once": once}.get(mistake, order)
        picks = order.split(cfg.minibatch)
        if mistake == "most samples are not used":
            picks = picks[:1]
        elif mistake == "the last, smaller minibatch is dropped":
            picks = [pick for pick in picks if len(pick) == cfg.minibatch]
        for pick in picks:
            seen = torch.randperm(len(obs))[: len(pick)] if "other" in mistake else pick
            log_prob = model.policy(obs[seen]).log_prob(action[pick])
            old = old_log_prob[: len(pick)] if "order" in mistake else old_log_prob[pick]
            ratio = (log_prob - (log_prob.detach() if "always 1" in mistake else old)).exp()
            a = advantages[pick]
            if "normali" not in mistake:
                a = (a - a.mean()) / (a.std(correction=0) + 1e-8)
            critic_loss = nn.functional.mse_loss(model.value(obs[pick]), targets[pick])
            if mistake == "half the squared error":
                critic_loss = critic_loss / 2
            weight = 1 if mistake == "no c_V" else cfg.value_coef
            gain = clipped_objective(ratio, a, cfg.clip).mean()
            loss = (gain if "objective" in mistake else -gain) + weight * critic_loss
            if mistake != "zero_grad is forgotten":
                optimizer.zero_grad()
            loss.backward()
            limited = model.actor if mistake == "limits the actor's gradient only" else model
            if mistake != "gradients of any length":
                nn.utils.clip_grad_norm_(limited.parameters(), cfg.max_grad_norm)
            optimizer.step()
    with torch.no_grad():
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob
        ratio = log_ratio.exp()
        outside = (ratio < 1 - cfg.clip) | (ratio > 1 + cfg.clip)
        kl = ratio - 1 - log_ratio
        if mistake == "the entropy after the update":
            entropy = model.policy(obs).entropy().mean().item()
        return {
            "entropy": entropy,
            "explained_variance": 1 - float(unexplained),
            "clip_fraction": outside.float().mean().item(),
            "approx_kl": (log_ratio if "KL" in mistake else kl).mean().item(),
            "value_loss": ((model.value(obs) - targets) ** 2).mean().item(),
        }


# ------------------------------------------------------------------------ stage 5
@wrong("one long Euler step", "by Euler")
@wrong("of one number only", "batches [n, …]")
def low_pass(velocity, command, seconds, time_constant):
    if mistake == "of one number only":
        velocity, command = float(velocity), float(command)
    return velocity + min(1, seconds / max(time_constant, 1e-9)) * (command - velocity)


@right("as the formula is written, not clipped")
@wrong("no width at 0 and 1", "Wald")
def wilson(count, total, z=1.96):
    p = count / total
    more = 0 if mistake == "no width at 0 and 1" else z**2 / total
    margin = math.sqrt(z**2 * p * (1 - p) / total + more**2 / 4)
    return [(p + more / 2 + side) / (1 + more) for side in (-margin, margin)]


@right("in single precision")
@wrong("β near the goal, too", "turn to α")
@wrong("the yaw as given", "10° to the right")
@wrong("each axis on its own", "a box")
@wrong("round between the axes", "an ellipse")
def velocity_command(goal, settings):
    d, alpha, beta = env.polar(goal)
    if mistake == "the yaw as given":
        alpha = goal[:, 2]
    cos, sin = np.cos(beta), np.sin(beta)
    front, back, side = settings.forward, settings.backward, settings.sideways
    x_max = np.where(cos >= 0, front, back)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / side)
    if mistake == "round between the axes":
        v_max = 1 / np.hypot(cos / x_max, sin / side)
    v = settings.gain * d
    if mistake != "each axis on its own":
        v = np.minimum(v, v_max)
    far = (d > settings.far_m) | (mistake == "β near the goal, too")
    omega = settings.turning_gain * np.where(far, beta, alpha)
    omega = np.clip(omega, -settings.turning, settings.turning)
    v_x, v_y = np.clip(v * cos, -back, front), np.clip(v * sin, -side, side)
    return np.stack([v_x, v_y, omega], -1).astype(np.float32)


@wrong("both feet step outward", "sideways: one foot takes it all")
@wrong("both feet turn alike in their own frames", "are mirrored")
@wrong("the share of the sideways way for the turn, too", "turn: either foot")
def velocity_to_footsteps(velocity, period, lead=(1, 0.5)):
    forward, way = velocity[:, 0] * period / 2, velocity[:, 1:] * period
    if mistake == "the share of the sideways way for the turn, too":
        lead = lead[0]
    out = np.multiply(lead, way)
    left, right = np.where(way > 0, out, way - out), -np.where(way > 0, way - out, out)
    if mistake == "both feet step outward":
        left = right = np.abs(out)
    elif mistake == "both feet turn alike in their own frames":
        right = right * [1, -1]
    return np.stack([np.column_stack([forward, side]) for side in (left, right)], 1)


@wrong("two independent resamples", "paired")
@wrong("without replacement", "with replacement")
@wrong("never the last walk", "the first and the last")
@wrong("row by row", "arrays [resamples, n]")
def bootstrap(statistic, *samples, resamples=2000):
    rng, count = np.random.default_rng(0), len(samples[0])
    pick = rng.integers(count - (mistake == "never the last walk"), size=(resamples, count))
    if mistake == "without replacement":
        pick = pick.argsort(1)
    two = mistake == "two independent resamples"
    drawn = [sample[rng.permutation(pick) if two else pick] for sample in samples]
    found = map(statistic, *drawn) if mistake == "row by row" else statistic(*drawn)
    return np.percentile([*found], [2.5, 97.5])


@wrong("the mean of ratios", "a ratio of the means")
@wrong("the interval of the mean of ratios", "not of the mean of the ratios")
@wrong("the mean of nothing", "an empty dict")
@wrong("who did not fall arrived", "no time-out")
@wrong("who stays arrived", "still there or not")
@wrong("twenty trials", "19 goals that both reached")
@wrong("faster by a tick", "double steps")
def time_ratio(trials, reference):
    def reached(row):
        if mistake == "who stays arrived":
            return row["still_there"]
        return row["outcome"] != "fall" if "not fall" in mistake else row["outcome"] == "success"

    def ratio(x, y, of_ratios="the interval of the mean of ratios"):
        return (x / y).mean(-1) if mistake == of_ratios else x.mean(-1) / y.mean(-1)

    both = reached(trials) & reached(reference)
    if not both.any():
        return {"goals": 0, "time_ratio": math.nan} if mistake == "the mean of nothing" else {}
    a, b = trials["time"][both], reference["time"][both]
    enough = len(both if mistake == "twenty trials" else a) >= 20
    more = trials["steps"][both] - reference["steps"][both]
    if mistake == "faster by a tick":
        more = a - b
    return {
        "goals": len(a),
        "time_ratio": ratio(a, b, "the mean of ratios"),
        "time_ratio_ci95": [*bootstrap(ratio, a, b)] if enough else [math.nan] * 2,
        "faster": np.mean(more < 0),
        "equal": np.mean(more == 0),
        "slower": np.mean(more > 0),
    }


# ------------------------------------------------------------------------ studies
@right("corner by corner")
@wrong("no interpolation", "mean of the eight corners")
@wrong("cuts negative yaws towards 0", "after the last yaw, the first")
@wrong("extrapolates beyond the map", "Beyond the map")
def look_up(value, poses):
    edge = CELL * HALF - 1e-6
    if mistake != "extrapolates beyond the map":
        poses = np.concatenate([np.clip(poses[..., :2], -edge, edge), poses[..., 2:]], -1)
    cells = poses / (CELL, CELL, TURN) + (HALF, HALF, 0)
    if mistake == "no interpolation":
        i, j, k = np.moveaxis(np.rint(cells).astype(int), -1, 0)
        return value[k % TURNS, i, j]
    low = np.floor(cells).astype(int)
    if mistake == "cuts negative yaws towards 0":
        low = cells.astype(int)
    else:
        low[..., :2] = np.clip(low[..., :2], 0, 2 * HALF - 1)
    (i, j, k), share, total = np.moveaxis(low, -1, 0), cells - low, 0.0
    for a, b, c in np.ndindex(2, 2, 2):
        part = np.where([a, b, c], share, 1 - share).prod(-1)
        total = total + value[(k + c) % TURNS, i + a, j + b] * part
    return total


@right("by look_up")
@right("from 0 upward")
@wrong("comes back on the other side of the map", "The map ends at its edge")
@wrong("only the goal's own cell", "within 5 cm it has arrived")
@wrong("the maximum over the moves", "V[yaw, x, y]")
@wrong("stops too early", "until nothing changes")
@wrong("moves turned by −yaw", "turned by −yaw")
@wrong("V[yaw, y, x]", "are x and y swapped")
@wrong("no interpolation between the yaws", "V = 1 + min over moves")
@wrong("the goal without its yaw", "V = 0 at the goal")
@wrong("the step itself costs nothing", "V = 1 + min over moves")
@wrong("the yaw does not turn with the move", "V[yaw, x, y]")
def steps_to_go(moves, task):
    axis, yaws = CELL * np.arange(-HALF, HALF + 1), TURN * np.arange(TURNS)
    x, y, yaw = np.meshgrid(axis, axis, yaws, indexing="ij")
    poses = np.stack([x, y, yaw], -1)  # [x, y, yaw, 3]
    tolerance = 0 if mistake == "only the goal's own cell" else task.success_m
    goal = np.hypot(x, y) <= tolerance + 1e-9
    if mistake != "the goal without its yaw":
        goal &= np.abs(robot_model.wrap(yaw)) <= task.success_rad + 1e-9
    sign = [1, 1, -1] if mistake == "moves turned by −yaw" else [1, 1, 1]
    after = robot_model.compose(poses[..., None, :] * sign, np.array(moves, float)) * sign
    if mistake == "the yaw does not turn with the move":
        after[..., 2] = poses[..., None, 2]
    elif mistake == "no interpolation between the yaws":
        after[..., 2] = np.rint(after[..., 2] / TURN) * TURN
    width = CELL * (2 * HALF + 1)
    if mistake == "comes back on the other side of the map":
        after[..., :2] = (after[..., :2] + width / 2) % width - width / 2
    outside = (np.abs(after[..., :2]) > CELL * HALF + 1e-9).any(-1)
    value = np.where(goal, 0.0, FAR).transpose(2, 0, 1)  # [yaw, x, y]
    if mistake == "from 0 upward":
        value = 0 * value
    for _ in range(3 if mistake == "stops too early" else 60):
        reached = np.where(outside, FAR, look_up(value, after))  # [x, y, yaw, A]
        best = reached.max(-1) if mistake == "the maximum over the moves" else reached.min(-1)
        cost = 0 if mistake == "the step itself costs nothing" else 1
        value = np.where(goal, 0.0, np.minimum(best + cost, FAR)).transpose(2, 0, 1)
    return value.swapaxes(1, 2) if mistake == "V[yaw, y, x]" else value


# ------------------------------------------------------------------------ the Beta distribution
@wrong("by PyTorch", "write the formula")
def beta_log_prob(x, alpha, beta):
    return torch.distributions.Beta(alpha, beta).log_prob(x).sum(-1)


@wrong("by PyTorch", "write the formula")
@wrong("a small number below", "loses the digits")
def beta_mode(alpha, beta):
    left, right = alpha - 1, beta - 1
    if mistake == "a small number below":
        return left / (left + right + 1e-6)
    return torch.where(left + right == 0, 0.5, torch.distributions.Beta(alpha, beta).mode)


@wrong("by PyTorch", "write the formula")
def beta_entropy(alpha, beta):
    return torch.distributions.Beta(alpha, beta).entropy().sum(-1)
