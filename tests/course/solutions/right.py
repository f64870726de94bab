"""Right solutions of the exercises in other ways than ours; the grader must accept each of them.

A function takes the place of that of the same name in its stage, as those of `wrong.py` do.
"""
# ruff: noqa: F811, F821


def wrap(angle):
    """Whole turns counted by floor."""
    return angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))


def compose(base, pose):
    """Adds and overwrites the place."""
    total = base + pose
    total[..., :2] = base[..., :2] + turned(pose[..., :2], base[..., 2])
    return total


def compose(base, pose):
    """Complex numbers."""
    place = base[..., 0] + 1j * base[..., 1]
    place = place + np.exp(1j * base[..., 2]) * (pose[..., 0] + 1j * pose[..., 1])
    return np.stack([place.real, place.imag, base[..., 2] + pose[..., 2]], -1)


def fallen(torso, standing_height):
    """The torso's z axis as a column of the rotation."""
    up = rotation(torso[..., 3], torso[..., 4], torso[..., 5])[..., 2, 2]
    return (torso[..., 2] / standing_height < 0.5) | (up < np.sqrt(0.5))


def fallen(torso, standing_height):
    """The angle itself."""
    roll, pitch = torso[..., 3], torso[..., 4]
    tilt = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1))
    return np.logical_or(torso[..., 2] < standing_height / 2, np.degrees(tilt) > 45)


def link_frames(robot, torso, joints):
    """Robot by robot, by homogeneous matrices."""

    def frame(x, y, z, roll=0, pitch=0, yaw=0):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation(roll, pitch, yaw), (x, y, z)
        return matrix

    frames = np.zeros((*joints.shape[:-1], 9, 4, 4))
    for i in np.ndindex(joints.shape[:-1]):
        frames[i][0] = frame(*torso[i])
        for first, side, leg in (1, 1, joints[i][:6]), (5, -1, joints[i][6:]):
            yaw, roll, pitch, knee, ankle_pitch, ankle_roll = leg
            hip = frames[i][0] @ frame(0, side * robot.hip_y, robot.hip_z, roll, 0, yaw)
            thigh = hip @ frame(robot.hip_x, 0, 0, 0, pitch)
            shin = thigh @ frame(0, 0, -robot.thigh_length, 0, knee)
            foot = shin @ frame(0, 0, -robot.shin_length, ankle_roll, ankle_pitch)
            frames[i][first : first + 4] = hip, thigh, shin, foot
    return frames[..., :3, 3], frames[..., :3, :3]


def leg_inverse(robot, position, foot_turn):
    """The shin's angle by the law of sines."""
    thigh, shin = robot.thigh_length, robot.shin_length
    rx, ry, rz = np.moveaxis(np.einsum("...ji,...j->...i", foot_turn, -position), -1, 0)
    ankle_roll = np.arctan2(ry, rz)
    zero = np.zeros_like(ankle_roll)
    M = np.einsum("...ij,...jk->...ik", foot_turn, rotation(-ankle_roll, zero, zero))
    pitches = np.arctan2(-M[..., 2, 0], M[..., 2, 2])
    rx = rx + robot.hip_x * np.cos(pitches)
    ry = ry + robot.hip_x * np.sin(pitches) * np.sin(ankle_roll)
    rz = rz + robot.hip_x * np.sin(pitches) * np.cos(ankle_roll)
    length = np.sqrt(rx**2 + ry**2 + rz**2)
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    from_shin = -np.arcsin(np.clip(thigh * np.sin(knee) / reach, -1, 1))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    yaw = np.arctan2(-M[..., 0, 1], M[..., 1, 1])
    roll = np.arcsin(np.clip(M[..., 2, 1], -1, 1))
    pitch = pitches - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)


def leg_inverse(robot, position, foot_turn):
    """Leg by leg, the hip's roll by arctan2."""
    if np.ndim(position) > 1:
        return np.array([leg_inverse(robot, p, turn) for p, turn in zip(position, foot_turn)])
    L1, L2 = robot.thigh_length, robot.shin_length
    r = -foot_turn.T @ position
    ankle_roll = math.atan2(r[1], r[2])
    M = foot_turn @ rotation(-ankle_roll, 0.0, 0.0)
    r = r + robot.hip_x * foot_turn.T @ M @ rotation(0.0, -math.atan2(-M[2, 0], M[2, 2]), 0.0)[:, 0]
    low = math.sqrt(L1**2 + L2**2 + 2 * L1 * L2 * math.cos(robot.joint_max[3]))
    d = min(max(np.linalg.norm(r), low), L1 + L2)
    knee = math.acos(min(1, max(-1, (d * d - L1 * L1 - L2 * L2) / (2 * L1 * L2))))
    inner = math.acos(min(1, max(-1, (L2 * L2 + d * d - L1 * L1) / (2 * L2 * d))))
    ankle_pitch = -inner - math.atan2(r[0], math.hypot(r[1], r[2]))
    yaw = math.atan2(-M[0, 1], M[1, 1])
    roll = math.atan2(M[2, 1], math.hypot(M[2, 0], M[2, 2]))
    pitch = math.atan2(-M[2, 0], M[2, 2]) - knee - ankle_pitch
    joints = [yaw, roll, pitch, knee, ankle_pitch, ankle_roll]
    return np.array(
        [min(max(a, low), high) for a, low, high in zip(joints, robot.joint_min, robot.joint_max)]
    )


def capture_step(error, over, swings, old, p):
    """Foot by foot."""
    outside = np.abs(error) - p.usual_lean
    e = p.capture * np.sign(error) * np.where(outside > 0, outside, 0)
    new = (1 - p.fade) * old
    for n, foot in np.argwhere(swings):
        back = p.trunk_height * e[n, 0] if over[n] > 0 else 0.0
        new[n, foot] = (1 - p.follow) * old[n, foot] + p.follow * np.array([back, *e[n]])
    return new


def capture_step(error, over, swings, old, p):
    """With shares."""
    roll, pitch = p.capture * (error - np.clip(error, -p.usual_lean, p.usual_lean)).T
    wanted = np.stack([(over > 0) * p.trunk_height * roll, roll, pitch], -1)[:, None, :]
    swinging = swings[:, :, None].astype(float)
    share = p.follow * swinging + p.fade * (1 - swinging)
    return old + share * (swinging * wanted - old)


def waiting_pace(over, p):
    """By minimum and maximum."""
    return np.minimum(1.0, np.maximum(0.0, 1 - p.wait * (over - p.late_lean)))


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


def quintic(start, end, duration):
    """Three equations, by the inverse of a matrix."""
    start, T = np.asarray(start, float), duration
    miss = end - start @ [[1, 0, 0], [T, 1, 0], [T**2 / 2, T, 1]]
    matrix = [[T**3, 3 * T**2, 6 * T], [T**4, 4 * T**3, 12 * T**2], [T**5, 5 * T**4, 20 * T**3]]
    return np.concatenate([start / [1, 1, 2], miss @ np.linalg.inv(matrix)], -1)


def _swing(self, start, landing):
    """Axis by axis."""
    wait = self.parameters.double_support * self.step_time
    T = self.step_time - wait
    t = np.linspace(0, self.step_time, self.parameters.step_ticks + 1) - wait
    t = np.minimum(np.maximum(t, 0), T)
    foot = np.empty((start.shape[0], t.size, 4))
    for axis, column in enumerate((0, 1, 3)):
        for robot in range(start.shape[0]):
            c = quintic([start[robot, axis], 0, 0], [landing[robot, axis], 0, 0], T)
            foot[robot, :, column] = np.polynomial.polynomial.polyval(t, c)
    up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], T / 2)
    foot[:, :, 2] = polynomial(up, np.where(t > T / 2, T - t, t))
    return foot


def _knot(self, support, start, landing):
    """Robot by robot."""
    p, knot = self.parameters, np.zeros((len(support), 6, 3))
    for i in range(len(support)):
        before, after = (support[i] + start[i]) / 2, (support[i] + landing[i]) / 2
        x, y, yaw = (before + after) / 2
        side = -(support[i, 0] - x) * np.sin(yaw) + (support[i, 1] - y) * np.cos(yaw)
        aside = p.trunk_swing * side
        knot[i, 0, 0] = x + p.trunk_x_offset * np.cos(yaw) - aside * np.sin(yaw)
        knot[i, 1, 0] = y + p.trunk_x_offset * np.sin(yaw) + aside * np.cos(yaw)
        knot[i, 2, 0] = p.trunk_height
        knot[i, 5, 0] = yaw
        knot[i, [0, 1, 5], 1] = (after - before) / self.step_time
        knot[i, 4, 0] = p.trunk_pitch
        knot[i, 3, 0] = -p.trunk_roll if side > 0 else p.trunk_roll
    return knot


def _knot(self, support, start, landing):
    """The middle of three feet with weights."""
    p = self.parameters
    before = 0.5 * support + 0.5 * start
    after = before + 0.5 * (landing - start)
    centre = 0.5 * support + 0.25 * (start + landing)
    side = robot_model.turned((support - centre)[:, :2], -centre[:, 2])[:, 1]
    aside = p.trunk_swing * side
    offset = np.stack([np.full_like(aside, p.trunk_x_offset), aside, 0 * aside], -1)
    knot = np.zeros((len(centre), 6, 3))
    knot[:, [0, 1, 5], 0] = compose(centre, offset)
    knot[:, [0, 1, 5], 1] = (after - before) / self.step_time
    knot[:, 2, 0] = p.trunk_height
    knot[:, 3, 0] = -p.trunk_roll * np.sign(side)
    knot[:, 4, 0] = p.trunk_pitch
    return knot


def encode_goal(goal):
    """Number by number."""
    import math

    encoded = np.zeros((*goal.shape[:-1], 8), np.float32)
    for i in np.ndindex(goal.shape[:-1]):
        x, y, yaw = (float(v) for v in goal[i])
        d, beta = math.hypot(x, y), math.atan2(y, x)
        yaw = float(wrap(yaw))
        encoded[i] = (
            min(d, 2),
            *(max(-1, min(1, 2 * v)) for v in (x, y)),
            *(turn(angle) for angle in (beta, yaw) for turn in (math.cos, math.sin)),
            yaw / math.pi,
        )
    return encoded


def to_action(footsteps, limits):
    """In single precision, as the policy's are."""
    span = np.broadcast_to(np.subtract(limits.high, limits.low), np.shape(footsteps))
    share = np.full(span.shape, 0.5, np.float32)
    np.divide(np.subtract(footsteps, limits.low), span, share, where=span > 0, casting="unsafe")
    return np.clip(share, 0, 1).reshape(*share.shape[:-2], 6)


def potentials(goal, near_m):
    """Np.where, exp by a product of the two shares."""
    d, alpha, beta = polar(goal)
    x, y = goal[:, 0], goal[:, 1]
    near = np.exp(-((x / near_m) ** 2)) * np.exp(-((y / near_m) ** 2))
    return np.stack([-d, -np.abs(alpha) * near, -np.abs(beta) * (1 - near)])


def potentials(goal, near_m):
    """Term by term, without stack."""
    d, alpha, beta = polar(goal)
    near = np.exp(-((d / near_m) ** 2))
    phi = np.zeros((3, len(goal)))
    phi[0], phi[1] = -d, -abs(alpha) * near
    phi[2] = -abs(beta) * (1 - near)
    return phi


def predict(goal, covariance, motion, drift):
    """Robot by robot: the errors before and those of the double step are sides of one matrix."""
    goal = robot_model.relative(motion, goal)
    after = np.empty_like(covariance)
    for i, (x, y, _) in enumerate(goal):
        cos, sin = np.cos(motion[i, 2]), np.sin(motion[i, 2])
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        sides = np.array([[-1, 0, y], [0, -1, -x], [0, 0, -1]]) * drift
        after[i] = turn @ covariance[i] @ turn.T + sides @ sides.T
    return goal, after


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


def low_pass(velocity, command, seconds, time_constant):
    """A weighted mean."""
    left = math.exp(-seconds / time_constant) if time_constant > 0 else 0.0
    return left * velocity + (1 - left) * command


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
    """Outward and inward parts."""
    x, way = velocity[:, 0] * period / 2, velocity[:, 1:] * period
    lead = np.array(lead)
    left = lead * np.maximum(way, 0) + (1 - lead) * np.minimum(way, 0)
    right = lead * np.maximum(-way, 0) + (1 - lead) * np.minimum(-way, 0)
    return np.stack([np.c_[x, left], np.c_[x, right]], axis=1)


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
    """Sorted, another order."""
    count = len(samples[0])
    pick = np.random.default_rng(0).integers(count, size=(resamples, count))
    drawn = np.sort(statistic(*(sample[pick] for sample in samples)))
    return [drawn[round(share * (resamples - 1))] for share in (0.025, 0.975)]


def bootstrap(statistic, *samples, resamples=2000):
    """One resample at a time."""
    n = len(samples[0])
    rng, found = np.random.default_rng(7), []
    for _ in range(resamples):
        pick = rng.choice(n, (1, n))
        found.extend(statistic(*(np.take(sample, pick) for sample in samples)))
    return np.quantile(found, 0.025), np.quantile(found, 0.975)


def highest_speed(poses, fall, period):
    """Np.minimum.accumulate."""
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])
        unbroken = np.minimum.accumulate(fall[rows] >= len(PATTERN))
        speeds[direction] = float(np.max(moved * unbroken) / (sum(PATTERN) * period))
    return speeds


def highest_speed(poses, fall, period):
    """The first fall by argmax."""
    fell = fall.reshape(-1, LEVELS) < len(PATTERN)
    count = np.where(fell.any(1), fell.argmax(1), LEVELS)
    way = np.abs(poses[:, -1] - poses[:, 0]).reshape(-1, LEVELS, 3)
    return {
        direction: way[i, : count[i], axis].max(initial=0) / period / np.sum(PATTERN)
        for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items())
    }


def look_up(value, poses):
    """A wider map."""
    wide = np.pad(value, ((0, 1), (0, 0), (0, 0)), mode="wrap")
    wide = np.pad(wide, ((0, 0), (0, 1), (0, 1)), mode="edge")
    x, y = (np.clip(poses[..., k] / CELL + HALF, 0, 2 * HALF) for k in (0, 1))
    yaw = poses[..., 2] / TURN % TURNS
    total = 0
    for a, b, c in np.ndindex(2, 2, 2):
        weight = 1
        for at, one in ((x, a), (y, b), (yaw, c)):
            weight = weight * (at % 1 if one else 1 - at % 1)
        total = total + weight * wide[yaw.astype(int) + c, x.astype(int) + a, y.astype(int) + b]
    return total


def beta_log_prob(x, alpha, beta):
    """Ln B as the log of a ratio."""
    log_p = (alpha - 1) * torch.log(x) + (beta - 1) * torch.log(1 - x)
    return (log_p - log_beta_function(alpha, beta)).sum(-1)


def log_beta_function(alpha, beta):
    """Ln B as the log of a ratio."""
    both = torch.special.gammaln(torch.stack([alpha, beta])).sum(0)
    return both - torch.special.gammaln(alpha + beta)


def beta_mode(alpha, beta):
    """Nan becomes 0.5."""
    left, right = alpha - 1, beta - 1
    return torch.nan_to_num(left / (left + right), nan=0.5)


def beta_mode(alpha, beta):
    """One over one plus the quotient."""
    quotient = (beta - 1) / (alpha - 1)
    return torch.where(torch.isnan(quotient), 0.5, 1 / (1 + quotient))


def beta_entropy(alpha, beta):
    """With E[ln x] and E[ln(1 − x)]."""
    both = torch.digamma(alpha + beta)
    ln_x, ln_rest = torch.digamma(alpha) - both, torch.digamma(beta) - both
    mean = (alpha - 1) * ln_x + (beta - 1) * ln_rest - log_beta_function(alpha, beta)
    return -mean.sum(-1)


def beta_entropy(alpha, beta):
    """Variables added up at once."""
    total = alpha + beta
    terms = torch.stack(
        [
            log_beta_function(alpha, beta),
            (1 - alpha) * torch.digamma(alpha),
            (1 - beta) * torch.digamma(beta),
            (total - 2) * torch.digamma(total),
        ]
    )
    return terms.sum((0, -1))
