"""Wrong solutions of the exercises, each with words that the grader must say when it rejects it.

A function takes the place of that of the same name in its stage, and sees what stands there. If it
has an argument `mistake`, it makes one of several: that which the line above it names.
"""
# ruff: noqa: F811, F821


def wrong(mistake, words):
    """A mark for the reader of this file, `tests/repository/test_workbook.py`."""
    return lambda function: function


# ------------------------------------------------------------------------ stage 1
@wrong("from 0 to 2π", "too few turns")
@wrong("(−π, π]", "π becomes −π")
@wrong("in degrees", "too few turns")
@wrong("a remainder with the sign of the angle", "too few turns")
@wrong("a half turn away", "same direction")
@wrong("takes away a single turn", "too few turns")
@wrong("writes into the angles", "must not be written to")
def wrap(angle, mistake):
    if mistake == "(−π, π]":
        return np.arctan2(np.sin(angle), np.cos(angle))
    if mistake == "in degrees":
        return (angle + 180) % 360 - 180
    if mistake == "a remainder with the sign of the angle":
        return np.fmod(angle + np.pi, 2 * np.pi) - np.pi
    if mistake == "a half turn away":
        return angle % (2 * np.pi) - np.pi
    if mistake == "takes away a single turn":
        angle = np.where(angle >= np.pi, angle - 2 * np.pi, angle)
        return np.where(angle < -np.pi, angle + 2 * np.pi, angle)
    if mistake == "writes into the angles":
        angle -= 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))
        return angle
    return angle % (2 * np.pi)


@wrong("adds without turning", "first turn the pose")
@wrong("by the pose's own yaw", "turn the pose by the base's yaw")
@wrong("by −yaw", "first turn the pose")
@wrong("wraps the yaw", "without wrap")
@wrong("forgets the yaw of the base", "yaws add up")
@wrong("writes into the base", "must not be written to")
@wrong("one pose, no batch", "too many values")
def compose(base, pose, mistake):
    if mistake == "adds without turning":
        return base + pose
    if mistake == "one pose, no batch":
        x, y, yaw = base
        dx, dy = turned(pose[:2], yaw)
        return np.array([x + dx, y + dy, yaw + pose[2]])
    angle = pose[..., 2] if mistake == "by the pose's own yaw" else base[..., 2]
    away = turned(pose[..., :2], -angle if mistake == "by −yaw" else angle)
    if mistake == "writes into the base":
        base[..., :2] += away
        return np.concatenate([base[..., :2], base[..., 2:] + pose[..., 2:]], -1)
    yaw = pose[..., 2:] + (0 if mistake == "forgets the yaw of the base" else base[..., 2:])
    return np.concatenate(
        [base[..., :2] + away, wrap(yaw) if mistake == "wraps the yaw" else yaw], -1
    )


@wrong("turns before it subtracts", "subtract the base's place")
@wrong("turns by +yaw", "turn back, by −yaw")
@wrong("writes into the pose", "must not be written to")
def relative(base, pose, mistake):
    if mistake == "turns before it subtracts":
        position = turned(pose[..., :2], -base[..., 2]) - base[..., :2]
        return np.concatenate([position, pose[..., 2:] - base[..., 2:]], -1)
    if mistake == "writes into the pose":
        pose -= base
        away = pose
    else:
        away = pose - base
    angle = base[..., 2] if mistake == "turns by +yaw" else -base[..., 2]
    return np.concatenate([turned(away[..., :2], angle), away[..., 2:]], -1)


@wrong("low AND tilted", "height 0.19 m")
@wrong("a fall backward is none", "pitch -46°")
@wrong("√(roll² + pitch²)", "roll 32°, pitch 32°")
@wrong("roll and pitch apart", "roll 35°, pitch 35°")
@wrong("roll and pitch added up", "roll 32°, pitch 32°")
@wrong("the yaw tilts, too", "roll 0°, pitch 0°")
@wrong("degrees and radians", "roll 46°")
@wrong("0.2 m by heart", "of 0.6 m")
@wrong("or", "truth value")
def fallen(torso, standing_height, mistake):
    roll, pitch, yaw = np.moveaxis(torso[..., 3:], -1, 0)
    cos_tilt = {
        "roll and pitch added up": np.cos(roll + pitch),
        "the yaw tilts, too": np.cos(roll) * np.cos(pitch) * np.cos(yaw),
    }.get(mistake, np.cos(roll) * np.cos(pitch))
    tilted = {
        "a fall backward is none": np.maximum(np.abs(roll), pitch) > np.pi / 4,
        "√(roll² + pitch²)": np.hypot(roll, pitch) > np.pi / 4,
        "roll and pitch apart": (np.abs(roll) > np.pi / 4) | (np.abs(pitch) > np.pi / 4),
        "degrees and radians": np.arccos(cos_tilt) > 45,
    }.get(mistake, cos_tilt < np.cos(np.pi / 4))
    low = torso[..., 2] < (0.2 if mistake == "0.2 m by heart" else standing_height / 2)
    if mistake == "or":
        return low or tilted
    return low & tilted if mistake == "low AND tilted" else low | tilted


@wrong("heel and toe exchanged", "foot_front and foot_back swapped")
@wrong("the knee turns the other way", "sign of a pitch")
@wrong("the ankle's roll is forgotten", "is the ankle's roll in it")
@wrong("the hip rolls first", "order of hip yaw and roll")
@wrong("the ankle rolls first", "behind all pitches")
@wrong("thigh and shin exchanged", "length")
@wrong("a rotation without the ankle's roll", "rotation that is returned")
@wrong("the knee alone bends the shin", "add up")
@wrong("heel and toe at the height of the ankle", "the ankle's height")
def leg_points(robot, joints, mistake):
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(joints, -1, 0)
    zero = 0 * yaw
    bent = pitch - knee if mistake == "the knee turns the other way" else pitch + knee
    down, back, front = robot.ankle_height, robot.foot_back, robot.foot_front
    thigh, shin = robot.thigh_length, robot.shin_length
    hip = rotation(roll, zero, yaw)
    if mistake == "the hip rolls first":
        hip = rotation(roll, zero, zero) @ rotation(zero, zero, yaw)
    flat = hip @ rotation(zero, bent + ankle_pitch, zero)
    foot = hip @ rotation(ankle_roll, bent + ankle_pitch, zero)
    if mistake == "the ankle's roll is forgotten":
        foot = flat
    elif mistake == "the ankle rolls first":
        foot = hip @ rotation(ankle_roll, zero, zero) @ rotation(zero, bent + ankle_pitch, zero)
    elif mistake == "thigh and shin exchanged":
        thigh, shin = shin, thigh
    elif mistake == "the knee alone bends the shin":
        bent = knee
    elif mistake == "heel and toe at the height of the ankle":
        down = 0
    knee_at = -thigh * (hip @ rotation(zero, pitch, zero))[..., 2]
    ankle = knee_at - shin * (hip @ rotation(zero, bent, zero))[..., 2]
    heel = ankle + foot @ np.array([-back, 0, -down])
    toe = ankle + foot @ np.array([front, 0, -down])
    if mistake == "heel and toe exchanged":
        heel, toe = toe, heel
    points = np.stack([0 * ankle, knee_at, ankle, heel, toe], -2)
    return points, flat if mistake == "a rotation without the ankle's roll" else foot


@wrong("the shin is taken for the line to the hip", "of the ankle turned round")
@wrong("too near: the knee folds completely", "the knee at its joint limit")
@wrong("too near: a straight leg", "a folded leg")
@wrong("too near: not along the line", "points at the wish")
@wrong("arccos of more than 1", "arccos")
@wrong("the ankle's roll stays", "taken out of the foot's rotation")
@wrong("of ±knee the negative one", "knee bend the other way")
@wrong("angles that no joint can take", "joint limits")
@wrong("the sign of the hip's yaw", "wrong: hip yaw (of hip yaw")
@wrong("seen in the hip's frame", "in the foot's frame")
@wrong("R, not its transpose", "in the foot's frame")
@wrong("law of cosines with a minus", "knee")
@wrong("writes into the position", "must not be written to")
def leg_inverse(robot, position, foot_turn, mistake):
    thigh, shin = robot.thigh_length, robot.shin_length
    subscripts = "...ij,...j->...i" if mistake == "R, not its transpose" else "...ji,...j->...i"
    r = np.einsum(subscripts, foot_turn, -position)
    if mistake == "seen in the hip's frame":
        r = -position
    elif mistake == "writes into the position":
        position *= -1
    length = np.linalg.norm(r, axis=-1)
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    if mistake == "too near: the knee folds completely":
        shortest = abs(thigh - shin)
    reach = np.clip(length, shortest, thigh + shin)
    if mistake == "too near: a straight leg":
        reach = np.where(length < shortest, thigh + shin, np.minimum(length, thigh + shin))
    elif mistake == "arccos of more than 1":
        reach = length
    cos_knee = (reach**2 - thigh**2 - shin**2) / (2 * thigh * shin)
    if mistake != "arccos of more than 1":
        cos_knee = np.clip(cos_knee, -1, 1)
    knee = np.arccos(-cos_knee if mistake == "law of cosines with a minus" else cos_knee)
    if mistake == "of ±knee the negative one":
        knee = -knee
    ankle_roll = np.arctan2(r[..., 1], r[..., 2])
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    if mistake == "the shin is taken for the line to the hip":
        from_shin = 0 * knee
    elif mistake == "too near: not along the line":
        share = (shin**2 + length**2 - thigh**2) / np.maximum(2 * shin * length, 1e-9)
        from_shin = -np.arccos(np.clip(share, -1, 1))
    ankle_pitch = from_shin - np.arctan2(r[..., 0], np.hypot(r[..., 1], r[..., 2]))
    back = 0 * ankle_roll if mistake == "the ankle's roll stays" else -ankle_roll
    M = np.einsum("...ij,...jk->...ik", foot_turn, rotation(back, 0 * back, 0 * back))
    yaw = np.arctan2(-M[..., 0, 1], M[..., 1, 1])
    if mistake == "the sign of the hip's yaw":
        yaw = -yaw
    roll = np.arcsin(np.clip(M[..., 2, 1], -1, 1))
    pitch = np.arctan2(-M[..., 2, 0], M[..., 2, 2]) - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    if mistake == "angles that no joint can take":
        return joints
    return np.clip(joints, robot.joint_min, robot.joint_max)


# ------------------------------------------------------------------------ stage 2
@wrong("the wrong sign", "measured rate − planned rate")
@wrong("roll and pitch exchanged", "x to the roll, y to the pitch")
@wrong("no planned rate", "− planned rate")
@wrong("the planned rate of one tick", "− planned rate")
@wrong("10 ms by heart", "another control_dt")
@wrong("20 ms by heart", "planned rate")
@wrong("no limit", "what is ADDED is limited")
@wrong("limits the rate", "what is ADDED is limited")
@wrong("limited upwards only", "to either side")
@wrong("both feet answer", "the ankle whose gain it is")
@wrong("the swing foot answers", "the ankle whose gain it is")
@wrong("the gain of the first tick", "whose gain it is")
def feedback(self, robot, tick, end, angular_velocity, mistake):
    seconds = {"10 ms by heart": 0.01, "20 ms by heart": 0.02}.get(mistake, robot.control_dt)
    ticks = 1 if mistake == "the planned rate of one tick" else end - tick
    planned = (self.trunk[:, end, 3:5] - self.trunk[:, tick, 3:5]) / (ticks * seconds)
    rate = np.repeat(angular_velocity[:, None], end - tick, 1)  # [n, ticks, 2]
    if mistake != "no planned rate":
        rate = rate - planned[:, None]
    if mistake == "the wrong sign":
        rate = -rate
    elif mistake == "limits the rate":
        rate = np.clip(rate, -REFLEX_LIMIT, REFLEX_LIMIT)
    gain = self.reflex_gain[:, tick:end]
    if mistake == "both feet answer":
        gain = gain + gain[..., ::-1]
    elif mistake == "the swing foot answers":
        gain = gain[..., ::-1]
    elif mistake == "the gain of the first tick":
        gain = gain[:, [0] * (end - tick)]
    turn = gain[..., None] * rate[:, :, None]  # [n, ticks, foot, 2]
    if mistake == "limited upwards only":
        turn = np.minimum(turn, REFLEX_LIMIT)
    elif mistake not in ("no limit", "limits the rate"):
        turn = np.clip(turn, -REFLEX_LIMIT, REFLEX_LIMIT)
    added = np.zeros((*turn.shape[:3], 6))
    added[..., [4, 5] if mistake == "roll and pitch exchanged" else [5, 4]] = turn
    return added.reshape(*turn.shape[:2], 12)


@wrong("a cubic, no accelerations", "position, velocity, acceleration")
@wrong("c₂ = a₀", "is c₂ = a₀/2")
@wrong("for one axis, no batch", "values to unpack")
@wrong("every spline takes a second", "the powers of")
@wrong("the highest power first", "c₀ comes first")
@wrong("the ½ is forgotten in what is missing", "end: position")
@wrong("unaccelerated at the end", "end: position")
@wrong("writes into the start", "must not be written to")
def quintic(start, end, duration, mistake):
    batch = (
        (start, end) if mistake == "for one axis, no batch" else np.moveaxis([start, end], -1, 1)
    )
    (p0, v0, a0), (p1, v1, a1) = batch
    D = 1.0 if mistake == "every spline takes a second" else duration
    if mistake == "a cubic, no accelerations":
        c2 = 3 * (p1 - p0) / D**2 - (2 * v0 + v1) / D
        c3 = -2 * (p1 - p0) / D**3 + (v0 + v1) / D**2
        return np.stack([p0, v0, c2, c3, 0 * p0, 0 * p0], -1)
    if mistake == "writes into the start":
        start[..., 2] /= 2
    half = 1 if mistake == "the ½ is forgotten in what is missing" else 0.5
    p = p1 - p0 - v0 * D - half * a0 * D**2
    v = v1 - v0 - a0 * D
    a = (0 if mistake == "unaccelerated at the end" else a1) - a0
    c3 = (20 * p - 8 * v * D + a * D**2) / (2 * D**3)
    c4 = (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4)
    c5 = (12 * p - 6 * v * D + a * D**2) / (2 * D**5)
    c = np.stack([p0, v0, a0 if mistake == "c₂ = a₀" else a0 / 2, c3, c4, c5], -1)
    return c[..., ::-1] if mistake == "the highest power first" else c


@wrong("every robot swings like the first one", "robots must not mix")
@wrong("rises during all of the swing", "lands at height 0")
@wrong("does not wait", "waits")
@wrong("waits again after landing", "lands at the end")
@wrong("waits after landing instead of before", "waits during")
@wrong("moves at a constant speed", "at rest")
@wrong("moves by a cubic", "without acceleration")
@wrong("a parabola", "at rest")
@wrong("rises half as high", "foot_rise")
@wrong("keeps its yaw", "lands where")
@wrong("the feet of one robot only", "could not be broadcast")
def _swing(self, start, landing, mistake):
    p = self.parameters
    wait = 0.0 if mistake == "does not wait" else p.double_support * self.half
    swing = self.half - (2 * wait if mistake == "waits again after landing" else wait)
    t = np.arange(p.half_ticks + 1) * self.robot.control_dt
    t = np.clip(t if mistake == "waits after landing instead of before" else t - wait, 0, swing)
    share = t / swing  # of the swing, [ticks]
    share = {
        "moves at a constant speed": share,
        "moves by a cubic": 3 * share**2 - 2 * share**3,
    }.get(mistake, 10 * share**3 - 15 * share**4 + 6 * share**5)
    one = 1 if mistake == "the feet of one robot only" else len(start)
    foot = np.zeros((one, len(t), 4))
    foot[..., [0, 1, 3]] = start[:, None] + share[:, None] * (landing - start)[:, None]
    if mistake == "keeps its yaw":
        foot[..., 3] = start[:, None, 2]
    rise = p.foot_rise / 2 if mistake == "rises half as high" else p.foot_rise
    longer = mistake == "rises during all of the swing"
    up = quintic([0, 0, 0], [rise, 0, 0], swing if longer else swing / 2)
    foot[..., 2] = polynomial(up, t if longer else np.minimum(t, swing - t))
    if mistake == "a parabola":
        foot[..., 2] = rise * (1 - (2 * t / swing - 1) ** 2)
    return foot[[0] * one] if mistake == "every robot swings like the first one" else foot


@wrong("leans by the way along the world's x", "in its own frame")
@wrong("leans by the way of the foot", "not of the foot")
@wrong("leans back with the step", "in its own frame")
@wrong("x_offset along the world's x", "AHEAD of their middle")
@wrong("x_offset is forgotten", "AHEAD of their middle")
@wrong("without velocity", "mean velocity")
@wrong("the velocity of a double step", "mean velocity")
@wrong("leans to the foot in the air", "SUPPORT foot")
@wrong("rolls towards the foot in the air", "a positive roll leans to the right")
@wrong("at the middle of the feet after the step", "half way")
@wrong("the yaw of the support foot", "yaw of the middle")
def _knot(self, support, start, landing, mistake):
    p = self.parameters
    before, after = (support + start) / 2, (support + landing) / 2
    moved = after - before
    late = mistake == "at the middle of the feet after the step"
    centre = after if late else (before + after) / 2
    side = robot_model.relative(centre, support)[:, 1]
    aside = side * p.trunk_swing * (-1 if mistake == "leans to the foot in the air" else 1)
    x = 0.0 if mistake == "x_offset is forgotten" else p.trunk_x_offset
    offset = np.stack([np.full_like(aside, x), aside, 0 * aside], -1)
    knot = np.zeros((len(centre), 6, 3))
    straight = mistake == "x_offset along the world's x"
    knot[:, [0, 1, 5], 0] = centre + offset if straight else compose(centre, offset)
    if mistake == "the yaw of the support foot":
        knot[:, 5, 0] = support[:, 2]
    if mistake != "without velocity":
        slow = mistake == "the velocity of a double step"
        knot[:, [0, 1, 5], 1] = moved / (self.period if slow else self.half)
    knot[:, 2, 0] = p.trunk_height
    way = landing - start if mistake == "leans by the way of the foot" else moved
    ahead = robot_model.turned(way[:, :2], -centre[:, 2])[:, 0]
    if mistake == "leans by the way along the world's x":
        ahead = moved[:, 0]
    elif mistake == "leans back with the step":
        ahead = -ahead
    roll = p.trunk_roll * np.sign(side)
    knot[:, 3, 0] = roll if mistake == "rolls towards the foot in the air" else -roll
    knot[:, 4, 0] = p.trunk_pitch + p.pitch_per_step * ahead
    return knot


# ------------------------------------------------------------------------ stage 3
@wrong("α and β exchanged", "α is not β")
@wrong("far goals beyond the bounds", "clipped")
@wrong("the yaw as it is given", "wrap the angle")
@wrong("x and y in metres", "2d·cos β")
@wrong("for one goal, no batch", "goals [..., 3] -> [..., 8]")
@wrong("sine before cosine", "cos β, sin β")
@wrong("α as a share of a whole turn", "α/π")
@wrong("4 m are not clipped", "clipped")
@wrong("y to the right", "2d·sin β")
@wrong("writes the wrapped yaw into the goal", "must not be written to")
def encode_goal(goal, mistake):
    if mistake == "for one goal, no batch":
        goal = np.ravel(goal)[:3]
    if mistake == "writes the wrapped yaw into the goal":
        goal[..., 2] = wrap(goal[..., 2])
    d, alpha, beta = polar(goal)
    if mistake == "α and β exchanged":
        alpha, beta = beta, alpha
    yaw = goal[..., 2] if mistake == "the yaw as it is given" else alpha
    zoomed = goal if mistake == "x and y in metres" else goal / 0.5
    if mistake != "far goals beyond the bounds":
        zoomed = np.clip(zoomed, -1, 1)
    near = d if mistake == "4 m are not clipped" else np.minimum(d, 2.0)
    y = -zoomed[..., 1] if mistake == "y to the right" else zoomed[..., 1]
    turn = 2 if mistake == "α as a share of a whole turn" else 1
    both = [np.cos(beta), np.sin(beta)]
    if mistake == "sine before cosine":
        both.reverse()
    rest = np.cos(alpha), np.sin(alpha), yaw / (turn * np.pi)
    return np.stack([near, zoomed[..., 0], y, *both, *rest], -1)


@wrong("sorted by axis, not by foot", "first the left foot")
@wrong("0.5 is no step", "0.5 their middle")
@wrong("for one robot, no batch", "actions [..., 6], any [...]")
@wrong("mirrors what the engine mirrors", "outward positive")
@wrong("low and high exchanged", "0 is low")
@wrong("1 is a step of high − low", "0 is low")
def to_footsteps(action, limits, mistake):
    shape = (-1,) if mistake == "for one robot, no batch" else np.shape(action)[:-1]
    share = np.reshape(action, (*shape, 2, 3))
    if mistake == "sorted by axis, not by foot":
        share = np.reshape(action, (*shape, 3, 2)).swapaxes(-1, -2)
    span = np.subtract(limits.high, limits.low)
    if mistake == "0.5 is no step":
        return (2 * share - 1) * limits.high
    if mistake == "low and high exchanged":
        return limits.high - share * span
    if mistake == "1 is a step of high − low":
        return share * span
    mirror = walk_engine.MIRROR if mistake == "mirrors what the engine mirrors" else 1
    return mirror * (limits.low + share * span)


@wrong("outside of [0, 1]", "clipped to [0, 1]")
@wrong("the lower limit is not subtracted", "the inverse")
@wrong("feet and axes stay apart", "actions [..., 6]")
@wrong("subtracts in place", "must not be written to")
def to_action(footsteps, limits, mistake):
    if mistake == "subtracts in place":
        footsteps -= np.array(limits.low)
    above = footsteps - (0 * footsteps if "lower" in mistake else np.array(limits.low))
    share = above / np.subtract(limits.high, limits.low)
    if mistake != "outside of [0, 1]":
        share = np.clip(share, 0, 1)
    return share if "apart" in mistake else share.reshape(*share.shape[:-2], 6)


@wrong("exp(−d²/0.4)", "near(d) = exp(−(d / 0.4 m)²)")
@wrong("α with its sign", "both signs are alike")
@wrong("β with its sign", "r_o of robot")
@wrong("the yaw as it is given", "not wrapped")
@wrong("0.4 m by heart", "scalar of this task")
@wrong("near instead of far", "far(d)")
@wrong("writes the wrapped yaw into the goals", "must not be written to")
def potentials(goal, near_m, mistake):
    if mistake == "writes the wrapped yaw into the goals":
        goal[:, 2] = wrap(goal[:, 2])
    d, alpha, beta = polar(goal)
    near = np.exp(-((d / (0.4 if mistake == "0.4 m by heart" else near_m)) ** 2))
    if mistake == "exp(−d²/0.4)":
        near = np.exp(-(d**2) / near_m)
    turn = goal[:, 2] if mistake == "the yaw as it is given" else alpha
    turn = turn if mistake == "α with its sign" else np.abs(turn)
    aside = beta if mistake == "β with its sign" else np.abs(beta)
    return np.stack([-d, -turn * near, -aside * (near if "instead" in mistake else 1 - near)])


@wrong("the sign of r_fall", "a fall costs")
@wrong("pays for being near", "progress")
@wrong("lengths, not squares", "−Σ (action − last action)²")
@wrong("one weight for before and after", "|α′|·near(d′)")
@wrong("before and after exchanged", "d before − d after")
@wrong("γ·Φ′ − Φ", "not γ·Φ′ − Φ")
@wrong("r_c adds up all robots", ".sum(-1)")
@wrong("continuity of x and y only", "over all six numbers")
@wrong("the default's scalars", "scalar of this task")
@wrong("one number for the time", "[n]")
@wrong("fall and success exchanged", "r_fall of robot")
def reward_terms(before, after, action, last_action, fall, success, task=Task(), *, mistake):
    if mistake == "the default's scalars":
        task = Task()
    now, then = potentials(after, task.near_m), potentials(before, task.near_m)
    progress = now - then
    if mistake == "pays for being near":
        progress[0] = now[0]
    elif mistake == "before and after exchanged":
        progress = -progress
    elif mistake == "γ·Φ′ − Φ":
        progress = 0.98 * now - then
    elif mistake == "one weight for before and after":
        near = np.exp(-((polar(after)[0] / task.near_m) ** 2))
        progress[1] = near * (np.abs(polar(before)[1]) - np.abs(polar(after)[1]))
    change = action - last_action
    squares = (change**2).sum(-1)
    if mistake == "lengths, not squares":
        squares = np.linalg.norm(change.reshape(-1, 2, 3), axis=-1).sum(-1)
    elif mistake == "r_c adds up all robots":
        squares = (change**2).sum()
    elif mistake == "continuity of x and y only":
        squares = (change[:, [0, 1, 3, 4]] ** 2).sum(-1)
    time = (
        -task.s_time if mistake == "one number for the time" else np.full(len(fall), -task.s_time)
    )
    cost = success if mistake == "fall and success exchanged" else fall
    return {
        "r_d": task.s_d * progress[0],
        "r_a": task.s_a * progress[1],
        "r_o": task.s_o * progress[2],
        "r_c": -task.s_c * squares,
        "r_fall": task.s_fall * cost if mistake == "the sign of r_fall" else -task.s_fall * cost,
        "r_goal": task.s_goal * success,
        "r_time": time,
    }


@wrong("moved the wrong way", "who turns left sees it turn right")
@wrong("moved without turning", "who turns left sees it turn right")
@wrong("a standard deviation is added", "V + drift² + lever")
@wrong("the lever is forgotten", "to the SIDE")
@wrong("the lever ahead instead of aside", "to the SIDE")
@wrong("the lever before the double step", "after the double step")
@wrong("the drift of a step is forgotten", "V + drift² + lever")
@wrong("the lever's angle is not squared", "to the SIDE")
@wrong("only the diagonal", "belong together")
@wrong("the lever to the other side", "belong together")
@wrong("the errors do not turn", "turn back with it")
@wrong("the errors turn the wrong way", "turn back with it")
@wrong("writes into the covariance", "must not be written to")
def predict(goal, covariance, motion, drift, mistake):
    moved = robot_model.relative(motion, goal)
    if mistake == "moved the wrong way":
        moved = robot_model.compose(motion, goal)
    elif mistake == "moved without turning":
        moved = goal - motion
    x, y, _ = goal.T if mistake == "the lever before the double step" else moved.T
    if "ahead" in mistake:
        x, y = y, x
    elif mistake == "the lever to the other side":
        x, y = -x, -y
    square = drift if mistake == "a standard deviation is added" else np.square(drift)
    if mistake == "the drift of a step is forgotten":
        square = 0 * drift
    lever = np.stack([-y, x, 0 * x], -1)
    if mistake == "the lever is forgotten":
        lever = 0 * lever
    both = lever[:, :, None] * lever[:, None] * drift[2] ** (1 if "not squared" in mistake else 2)
    both[:, :, 2] += lever * drift[2] ** 2
    both[:, 2] += lever * drift[2] ** 2
    added = both + np.diag(square)
    if mistake == "only the diagonal":
        added = added * np.eye(3)
    turn = {"the errors do not turn": 0, "the errors turn the wrong way": -1}.get(mistake, 1)
    yaw = turn * motion[:, 2]
    J = robot_model.rotation(0 * yaw, 0 * yaw, -yaw)
    if mistake == "writes into the covariance":
        covariance[:] = J @ covariance @ J.swapaxes(1, 2) + added
        return moved, covariance
    return moved, J @ covariance @ J.swapaxes(1, 2) + added


@wrong("the gain of the prediction", "K = V / (V + noise²)")
@wrong("a variance and a standard deviation in the gain", "K = V / (V + noise²)")
@wrong("a measurement makes nothing more certain", "(1 − K)·P")
@wrong("the error of an angle is not wrapped", "a small way, over π")
@wrong("the angle itself is not wrapped", "a small way, over π")
@wrong("the measurement is added, not the difference", "goal + K·(measured − goal)")
@wrong("every number for itself", "belong together")
@wrong("the matrix of the gain is not inverted", "K = V / (V + noise²)")
@wrong("writes into the goal", "must not be written to")
@wrong("writes into the measurement", "must not be written to")
def correct(goal, covariance, measured, noise, mistake):
    R = np.diag(noise if "standard" in mistake else np.square(noise))
    P = covariance * np.eye(3) if mistake == "every number for itself" else covariance
    gain = (R if "prediction" in mistake else P) @ np.linalg.inv(P + R)
    if "not inverted" in mistake:
        gain = P @ (P + R)
    if mistake == "writes into the measurement":
        measured -= goal
    error = measured.copy() if "added" in mistake else measured - goal
    if mistake != "the error of an angle is not wrapped":
        error[:, 2] = wrap(error[:, 2])
    change = (gain @ error[..., None])[..., 0]
    if mistake == "writes into the goal":
        goal += change
    else:
        goal = goal + change
    if mistake != "the angle itself is not wrapped":
        goal[:, 2] = wrap(goal[:, 2])
    return goal, covariance if "certain" in mistake else gain @ R


# ------------------------------------------------------------------------ stage 4
@wrong("to be minimised", "a minus too many")
@wrong("no minimum", "take the minimum")
@wrong("the larger product", "take the minimum")
@wrong("clips at 1 + ε only", "take the minimum")
@wrong("clips the product", "take the minimum")
@wrong("clips the advantage", "take the minimum")
@wrong("always 0.2", "ε is the argument")
@wrong("one number instead of one per sample", "per sample")
@wrong("through NumPy, without a gradient", "gradient")
@wrong("a gradient beyond the limit", "beyond 1 + ε")
def clipped_objective(ratio, advantage, clip, mistake):
    if mistake == "always 0.2":
        clip = 0.2
    if mistake == "through NumPy, without a gradient":
        ratio = ratio.detach()
    plain, clipped = ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage
    least = torch.min(plain, clipped)
    return {
        "to be minimised": -least,
        "no minimum": clipped,
        "the larger product": torch.max(plain, clipped),
        "clips at 1 + ε only": ratio.clamp(max=1 + clip) * advantage,
        "clips the product": plain.clamp(1 - clip, 1 + clip),
        "clips the advantage": torch.min(plain, ratio * advantage.clamp(1 - clip, 1 + clip)),
        "one number instead of one per sample": least.mean(),
        "a gradient beyond the limit": least.detach() + plain - plain.detach(),
    }.get(mistake, least)


@wrong("α, β, α, β", "all α and then all β")
@wrong("first all β", "all α and then all β")
@wrong("the concentration is always 10", "α + β")
@wrong("c − 1 instead of c − 2", "α + β")
@wrong("0 and 1 are not clamped", "no gradient")
@wrong("α = m·c puts the mean there", "m·(c−2)")
@wrong("softplus is not undone", "softplus⁻¹")
@wrong("softplus instead of its inverse", "softplus⁻¹")
@wrong("for a list only", "zero-dimensional tensor")
@wrong("of the critic", "doesn't match")
def __init__(
    self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0, *, mistake
):
    super().__init__()
    self.shape = {"obs_dim": obs_dim, "act_dim": act_dim, "hidden": hidden}
    self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
    self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
    mode = torch.as_tensor(first_action, dtype=torch.float32)
    mode = mode if mistake == "for a list only" else mode.expand(act_dim)
    mode = mode.clamp(0, 1) if mistake == "0 and 1 are not clamped" else mode.clamp(0.01, 0.99)
    excess = {
        "the concentration is always 10": 8.0,
        "c − 1 instead of c − 2": concentration - 1,
    }.get(mistake, concentration - 2)
    wanted = torch.cat([mode, 1 - mode]) * excess
    if mistake == "α, β, α, β":
        wanted = torch.stack([mode, 1 - mode], -1).flatten() * excess
    elif mistake == "first all β":
        wanted = torch.cat([1 - mode, mode]) * excess
    elif mistake == "α = m·c puts the mean there":
        mode = mode.clamp(0.11, 0.89)
        wanted = torch.cat([mode, 1 - mode]) * concentration - 1
    bias = {
        "softplus is not undone": wanted,
        "softplus instead of its inverse": nn.functional.softplus(wanted),
    }.get(mistake, torch.log(torch.expm1(wanted)))
    network = self.critic if mistake == "of the critic" else self.actor
    network[-1].bias.data.copy_(bias)


@wrong("no bootstrap after a cut-off", "does a fall zero")
@wrong("terminated and truncated exchanged", "does a fall zero")
@wrong("the flags of the row before", "does a fall zero")
@wrong("the sum goes on behind a fall", "a fall AND a cut-off")
@wrong("the sum goes on behind a cut-off", "a fall AND a cut-off")
@wrong("no γ in the sum", "γ·λ·A_{t+1}")
@wrong("no λ", "γ·λ·A_{t+1}")
@wrong("from the first step on", "from the last step backward")
@wrong("0·nan", "0·nan is nan")
@wrong("V of the next row", "next_values[t]")
@wrong("no γ before V(s')", "r + γ·V(s')")
@wrong("returns the critic's target", "minus V(s)")
@wrong("normalised", "not normalised")
@wrong("writes into next_values", "must not be written to")
def gae(rewards, values, next_values, terminated, truncated, gamma, lam, mistake):
    if mistake == "the flags of the row before":
        terminated, truncated = terminated.roll(1, 0), truncated.roll(1, 0)
    if mistake == "V of the next row":
        next_values = torch.cat([values[1:], next_values[-1:]])
    if mistake == "writes into next_values":
        next_values[terminated] = 0
    over = {
        "no bootstrap after a cut-off": terminated | truncated,
        "terminated and truncated exchanged": truncated,
    }.get(mistake, terminated)
    after = next_values * ~over if mistake == "0·nan" else next_values.masked_fill(over, 0)
    deltas = rewards + (1 if "before V" in mistake else gamma) * after - values
    goes_on = {
        "the sum goes on behind a fall": ~truncated,
        "the sum goes on behind a cut-off": ~terminated,
    }.get(mistake, ~(terminated | truncated))
    fade = {"no γ in the sum": lam, "no λ": gamma}.get(mistake, gamma * lam)
    advantages, following = torch.empty_like(rewards), torch.zeros_like(rewards[0])
    steps = range(len(rewards))
    for t in steps if mistake == "from the first step on" else reversed(steps):
        following = deltas[t] + fade * (goes_on[t] * following)
        advantages[t] = following
    if mistake == "normalised":
        return (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)
    return advantages + values if "target" in mistake else advantages


@wrong("no normalisation", "divide by std")
@wrong("no c_V", "value_coef")
@wrong("the sign of the objective", "the sign of the objective is wrong")
@wrong("gradients of any length", "as long as the gradient")
@wrong("limits the actor's gradient only", "actor and critic together")
@wrong("zero_grad is forgotten", "zero_grad")
@wrong("judges in every epoch", "is `judge` called more than once?")
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
def improve(model, optimizer, data, cfg, mistake):
    advantages, targets, old_log_prob = judge(model, data, cfg)
    obs, action = data["obs"].flatten(0, 1), data["action"].flatten(0, 1)
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean().item()
        unexplained = (targets - model.value(obs)).var() / targets.var()
    once = torch.randperm(len(obs))
    for _ in range(cfg.epochs):
        if mistake == "judges in every epoch":
            advantages, targets, old_log_prob = judge(model, data, cfg)
        order = torch.randperm(len(obs))
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
            if mistake != "no normalisation":
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
        kl = torch.expm1(log_ratio) - log_ratio
        if mistake == "the entropy after the update":
            entropy = model.policy(obs).entropy().mean().item()
        return {
            "entropy": entropy,
            "explained_variance": 1 - unexplained.item(),
            "clip_fraction": ((log_ratio.exp() - 1).abs() > cfg.clip).float().mean().item(),
            "approx_kl": (log_ratio if "KL" in mistake else kl).mean().item(),
            "value_loss": nn.functional.mse_loss(model.value(obs), targets).item(),
        }


# ------------------------------------------------------------------------ stage 5
@wrong("the sign", "is the sign right")
@wrong("τ = 0 is a division by zero", "division by zero")
@wrong("one long Euler step", "exp(−t/τ)")
@wrong("exp(−t/τ) of the way", "exp(−t/τ)")
@wrong("seconds and τ exchanged", "exp(−t/τ)")
@wrong("a product instead of a quotient", "exp(−t/τ)")
@wrong("fades to 0", "exp(−t/τ)")
@wrong("the command at once", "exp(−t/τ)")
@wrong("of one number only", "arrays")
@wrong("writes into the velocity", "must not be written to")
def low_pass(velocity, command, seconds, time_constant, mistake):
    if mistake == "of one number only":
        velocity, command = float(velocity), float(command)
    tau = time_constant if mistake == "τ = 0 is a division by zero" else max(time_constant, 1e-9)
    way, left = command - velocity, math.exp(-seconds / tau)
    if mistake == "writes into the velocity":
        velocity += (1 - left) * way
        return velocity
    return velocity + {
        "the sign": (left - 1) * way,
        "one long Euler step": min(1, seconds / tau) * way,
        "exp(−t/τ) of the way": left * way,
        "seconds and τ exchanged": (1 - math.exp(-tau / seconds)) * way,
        "a product instead of a quotient": (1 - math.exp(-seconds * tau)) * way,
        "fades to 0": (left - 1) * velocity,
        "the command at once": way,
    }.get(mistake, (1 - left) * way)


@wrong("z of another interval", "95 %")
@wrong("z by heart", "z is an argument")
@wrong("z²/4n instead of z²/4n²", "4n²")
@wrong("z²/n instead of z²/2n", "Wilson")
@wrong("not divided by 1 + z²/n", "Wilson")
@wrong("half of it is not divided", "Wilson")
@wrong("no width at 0 and 1", "Wilson")
@wrong("in percent", "Wilson")
@wrong("low and high exchanged", "Wilson")
def wilson(count, total, z=1.96, *, mistake):
    z = {"z of another interval": 1.645, "z by heart": 1.96}.get(mistake, z)
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (total if mistake == "z²/n instead of z²/2n" else 2 * total)
    more = z**2 / (4 * total if mistake == "z²/4n instead of z²/4n²" else 4 * total**2)
    margin = z * math.sqrt(p * (1 - p) / total + more)
    if mistake == "not divided by 1 + z²/n":
        shrink = 1
    low, high = (centre - margin) / shrink, (centre + margin) / shrink
    if mistake == "no width at 0 and 1":
        margin = z * math.sqrt(p * (1 - p) / total)
        low, high = p - margin, p + margin
    elif mistake == "half of it is not divided":
        low = centre / shrink - margin
    elif mistake == "in percent":
        return [100 * low, 100 * high]
    low, high = max(0.0, low), min(1.0, high)
    return [high, low] if mistake == "low and high exchanged" else [low, high]


@wrong("β near the goal, too", "turn to α")
@wrong("α from afar, too", "far:")
@wrong("far and near exchanged", "far:")
@wrong("the yaw as given", "10° to the right")
@wrong("turns away", "left")
@wrong("one limit for both signs of v_x", "backward taken for forward")
@wrong("backward and forward exchanged", "backward taken for forward")
@wrong("each axis on its own", "a box")
@wrong("round between the axes", "an ellipse")
@wrong("numbers instead of settings", "comes from `settings`")
@wrong("the gain multiplies what was limited", "min(gain·d, v_max)")
@wrong("always as fast as possible", "gain decides")
@wrong("x and y exchanged", "v_x ahead, v_y to the left")
@wrong("every robot gets the first one's command", "influence one another")
@wrong("writes the wrapped yaw into the goals", "must not be written to")
def velocity_command(goal, settings, mistake):
    if mistake == "numbers instead of settings":
        settings = BaselineSettings()
    if mistake == "writes the wrapped yaw into the goals":
        goal[:, 2] = env.wrap(goal[:, 2])
    d, alpha, beta = env.polar(goal)
    if mistake == "the yaw as given":
        alpha = goal[:, 2]
    cos, sin = np.cos(beta), np.sin(beta)
    front, back, side = settings.forward, settings.backward, settings.sideways
    if mistake == "backward and forward exchanged":
        front, back = back, front
    x_max = np.where((cos >= 0) | ("one limit" in mistake), front, back)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / side)
    if mistake == "round between the axes":
        v_max = 1 / np.hypot(cos / x_max, sin / side)
    v = np.minimum(settings.gain * d, v_max)
    if mistake == "the gain multiplies what was limited":
        v = settings.gain * np.minimum(d, v_max)
    elif mistake == "always as fast as possible":
        v = v_max
    error = {
        "β near the goal, too": beta,
        "α from afar, too": alpha,
        "far and near exchanged": np.where(d < settings.far_m, beta, alpha),
    }.get(mistake, np.where(d > settings.far_m, beta, alpha))
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    v_x, v_y = v * cos, v * sin
    if mistake == "each axis on its own":
        v_x = np.clip(settings.gain * d * cos, -back, front)
        v_y = np.clip(settings.gain * d * sin, -side, side)
    elif mistake == "x and y exchanged":
        v_x, v_y = v_y, v_x
    command = np.stack([v_x, v_y, -omega if mistake == "turns away" else omega], -1)
    return command[[0] * len(goal)] if "first one" in mistake else command


@wrong("each foot takes all of the way", "half the period's way")
@wrong("both feet step outward", "sideways: one foot takes it all")
@wrong("the left foot steps inward, too", "one foot takes it all")
@wrong("each foot takes half of the sideways way", "one foot takes it all")
@wrong("the right foot leads to the left", "sideways: one foot takes it all")
@wrong("both feet turn alike in their own frames", "are mirrored")
@wrong("the turn of the right foot as that of the left one", "mirrored")
@wrong("the paper's shares for everybody", "the other one the rest inward")
@wrong("the share of the sideways way for the turn, too", "turn: either foot")
@wrong("the other foot stays behind", "the other one")
@wrong("the first robot's speed for all", "robots must not influence")
@wrong("velocities become ways in place", "must not be written to")
def velocity_to_footsteps(velocity, period, lead=(1, 0.5), *, mistake):
    if mistake == "the first robot's speed for all":
        velocity = velocity[[0] * len(velocity)]
    ways = velocity * period
    if mistake == "velocities become ways in place":
        velocity *= period
    forward = ways[:, 0] / (1 if mistake == "each foot takes all of the way" else 2)
    lead = {
        "each foot takes half of the sideways way": (0.5, 0.5),
        "the paper's shares for everybody": (1, 0.5),
        "the share of the sideways way for the turn, too": (lead[0], lead[0]),
    }.get(mistake, lead)
    way = ways[:, 1:]
    out = np.multiply(lead, way)
    rest = 0 * way if mistake == "the other foot stays behind" else way - out
    leads = (way < 0) if mistake == "the right foot leads to the left" else (way > 0)
    left, right = np.where(leads, out, rest), -np.where(leads, rest, out)
    if mistake == "both feet step outward":
        left = right = np.abs(out)
    elif mistake == "the left foot steps inward, too":
        left, right = out, -rest
    elif mistake == "both feet turn alike in their own frames":
        right = right * [1, -1]
    elif mistake == "the turn of the right foot as that of the left one":
        right = right * [1, -1]
    return np.stack([np.column_stack([forward, left]), np.column_stack([forward, right])], 1)


@wrong("90 %", "2.5 and 97.5 %")
@wrong("92 %", "95 % of a normal distribution")
@wrong("98 %", "95 % of a normal distribution")
@wrong("two independent resamples", "paired")
@wrong("without replacement", "with replacement")
def bootstrap(statistic, *samples, resamples=2000, mistake):
    rng, count = np.random.default_rng(0), len(samples[0])
    shape = resamples, count
    pick = rng.integers(count, size=shape)
    if mistake == "without replacement":
        pick = np.array([rng.permutation(count) for _ in range(resamples)])
    drawn = [sample[pick] for sample in samples]
    if mistake == "two independent resamples":
        drawn = [sample[rng.integers(count, size=shape)] for sample in samples]
    beyond = {"90 %": 5, "92 %": 4, "98 %": 1}.get(mistake, 2.5)
    return np.percentile(statistic(*drawn), [beyond, 100 - beyond])


@wrong("counts the times of falls", "a fall's time")
@wrong("goals that we reached, whatever the reference did", "that both reached")
@wrong("the mean of ratios", "a ratio of the means")
@wrong("the interval of the mean of ratios", "not of the mean of the ratios")
@wrong("the mean of nothing", "no ratio")
@wrong("slower counts ties, too", "takes as long")
@wrong("the ratio of the medians", "goal by goal")
@wrong("theirs by ours", "mean time / mean time of the reference")
def time_ratio(trials, reference, mistake):
    mine, other = trials["outcome"] == "success", reference["outcome"] == "success"
    both = mine if mistake == "goals that we reached, whatever the reference did" else mine & other
    if not both.any():
        return {"goals": 0, "time_ratio": math.nan} if mistake == "the mean of nothing" else {}
    if mistake == "counts the times of falls":
        both = np.full(len(both), True)
    a, b = trials["time"][both], reference["time"][both]
    means = a.mean() / b.mean()
    of_ratios = mistake == "the interval of the mean of ratios"
    ties = mistake == "slower counts ties, too"
    return {
        "goals": len(a),
        "time_ratio": {"the mean of ratios": (a / b).mean(), "theirs by ours": 1 / means}.get(
            mistake, means
        ),
        "time_ratio_ci95": [
            *bootstrap(lambda x, y: (x / y).mean(1) if of_ratios else x.mean(1) / y.mean(1), a, b)
        ],
        "median": np.median(a) / np.median(b) if "medians" in mistake else np.median(a / b),
        "faster": np.mean(a < b),
        "slower": np.mean(a >= b if ties else a > b),
    }


# ------------------------------------------------------------------------ studies
@wrong("the way with its sign", "backward")
@wrong("the way over x and y", "along its axis")
@wrong("from the world's origin", "along its axis")
@wrong("a fast level counts although a slower one fell", "below the first one that fell")
@wrong("with the level that fell", "below the first one that fell")
@wrong("the last level that stood", "not the last one that stood")
@wrong("divides by the steps on the spot, too", "not on the spot")
def highest_speed(poses, fall, period, mistake):
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        way = poses[rows, -1] - poses[rows, 0]
        moved = np.abs(way[:, axis])
        if mistake == "the way with its sign":
            moved = way[:, axis]
        elif mistake == "the way over x and y":
            moved = np.linalg.norm(way, axis=-1)
        elif mistake == "from the world's origin":
            moved = np.abs(poses[rows, -1, axis])
        stood = fall[rows] == len(PATTERN)
        good = np.cumprod(stood)
        if mistake == "a fast level counts although a slower one fell":
            good = stood
        elif mistake == "with the level that fell":
            good = np.concatenate([[1], good[:-1]])
        elif mistake == "the last level that stood":
            good = good * (np.arange(LEVELS) == good.sum() - 1)
        steps = len(PATTERN) if "divides" in mistake else sum(PATTERN)
        speeds[direction] = float(np.max(moved * good) / (steps * period))
    return speeds


@wrong("no interpolation", "mean of the eight corners")
@wrong("linear in x and y only", "mean of the eight corners")
@wrong("between the last yaw and the first", "after the last yaw, the first")
@wrong("cuts negative yaws towards 0", "after the last yaw, the first")
@wrong("value[yaw, y, x]", "value[yaw, x, y]")
@wrong("extrapolates beyond the map", "Beyond the map")
@wrong("leaves the array at the edge", "out of bounds")
@wrong("the shares exchanged", "eight corners")
@wrong("clips the poses in place", "must not be written to")
def look_up(value, poses, mistake):
    edge = CELL * HALF - 1e-6
    if mistake == "clips the poses in place":
        np.clip(poses[..., :2], -edge, edge, out=poses[..., :2])
    if mistake not in ("extrapolates beyond the map", "leaves the array at the edge"):
        poses = np.concatenate([np.clip(poses[..., :2], -edge, edge), poses[..., 2:]], -1)
    cells = poses / (CELL, CELL, TURN) + (HALF, HALF, 0)
    if mistake == "no interpolation":
        i, j, k = np.moveaxis(np.rint(cells).astype(int), -1, 0)
        return value[k % TURNS, i, j]
    low = np.floor(cells).astype(int)
    if mistake == "cuts negative yaws towards 0":
        low = cells.astype(int)
    elif mistake == "extrapolates beyond the map":
        low[..., :2] = np.clip(low[..., :2], 0, 2 * HALF - 1)
    (i, j, k), share = np.moveaxis(low, -1, 0), cells - low
    total = 0.0
    for corner in np.ndindex(2, 2, 1 if mistake == "linear in x and y only" else 2):
        near = (np.array(corner) == 1) != (mistake == "the shares exchanged")
        part = np.where(near, share, 1 - share)
        a, b, c = corner
        turn = (k + c) % TURNS
        if mistake == "between the last yaw and the first":
            turn = np.minimum(k % TURNS + c, TURNS - 1)
        x, y = (j + b, i + a) if mistake == "value[yaw, y, x]" else (i + a, j + b)
        total = total + value[turn, x, y] * (
            part[..., :2].prod(-1) if mistake == "linear in x and y only" else part.prod(-1)
        )
    return total


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
def steps_to_go(moves, task, mistake):
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
    around = mistake == "comes back on the other side of the map"
    if around:
        after[..., :2] = (after[..., :2] + width / 2) % width - width / 2
    outside = (np.abs(after[..., :2]) > CELL * HALF + 1e-9).any(-1)
    value = np.where(goal, 0.0, FAR).transpose(2, 0, 1)  # [yaw, x, y]
    for _ in range(3 if mistake == "stops too early" else 60):
        reached = np.where(outside, FAR, look_up(value, after))  # [x, y, yaw, A]
        best = reached.max(-1) if mistake == "the maximum over the moves" else reached.min(-1)
        cost = 0 if mistake == "the step itself costs nothing" else 1
        value = np.where(goal, 0.0, np.minimum(best + cost, FAR)).transpose(2, 0, 1)
    return value.swapaxes(1, 2) if mistake == "V[yaw, y, x]" else value


# ------------------------------------------------------------------------ the Beta distribution
@wrong("α and β exchanged", "in their places")
@wrong("by PyTorch", "write the formula")
@wrong("the mean over the variables", "SUM")
@wrong("+ ln B", "is its sign")
@wrong("one number for all rows", "SUM over axis −1")
@wrong("ln(1 + x)", "or a term?")
@wrong("α instead of α − 1", "must be 1")
@wrong("the density itself", "must be 1")
def beta_log_prob(x, alpha, beta, mistake):
    if mistake == "by PyTorch":
        return torch.distributions.Beta(alpha, beta).log_prob(x).sum(-1)
    norm = log_beta_function(alpha, beta) * (-1 if mistake == "+ ln B" else 1)
    if mistake == "α and β exchanged":
        alpha, beta = beta, alpha
    less = 0 if mistake == "α instead of α − 1" else 1
    rest = torch.log1p(x if mistake == "ln(1 + x)" else -x)
    log_p = (alpha - less) * torch.log(x) + (beta - 1) * rest - norm
    return {
        "the mean over the variables": log_p.mean(-1),
        "one number for all rows": log_p.sum(),
        "the density itself": log_p.sum(-1).exp(),
    }.get(mistake, log_p.sum(-1))


@wrong("by PyTorch", "write the formula")
@wrong("α + β − 2", "loses the digits")
@wrong("a small number below", "loses the digits")
@wrong("flat wherever α = β after rounding", "loses the digits")
@wrong("the mean", "would be the mean")
@wrong("α and β exchanged", "α belongs to x")
@wrong("nan where it is flat", "0.5 here")
def beta_mode(alpha, beta, mistake):
    left, right = alpha - 1, beta - 1
    half = torch.full_like(left, 0.5)
    if mistake == "by PyTorch":
        return torch.where(left + right == 0, half, torch.distributions.Beta(alpha, beta).mode)
    flat = (left + right).abs() < (1e-6 if mistake.startswith("flat") else 1e-12)
    return {
        "α + β − 2": left / (alpha + beta - 2),
        "a small number below": left / (left + right + 1e-6),
        "the mean": alpha / (alpha + beta),
        "α and β exchanged": torch.where(flat, half, right / (left + right + flat)),
        "nan where it is flat": left / (left + right),
    }.get(mistake, torch.where(flat, half, left / (left + right + flat)))


@wrong("by PyTorch", "write the formula")
@wrong("ln Γ instead of ψ", "DIgamma")
@wrong("the mean over the variables", "every sign")
@wrong("− instead of +", "every sign")
@wrong("ln B is forgotten", "every sign")
@wrong("minus the entropy", "every sign")
@wrong("α + β instead of α + β − 2", "α + β − 2")
def beta_entropy(alpha, beta, mistake):
    if mistake == "by PyTorch":
        return torch.distributions.Beta(alpha, beta).entropy().sum(-1)
    psi = torch.lgamma if mistake == "ln Γ instead of ψ" else torch.digamma
    both = alpha + beta
    last = (both if mistake == "α + β instead of α + β − 2" else both - 2) * psi(both)
    each = (1 - alpha) * psi(alpha) + (1 - beta) * psi(beta)
    each = each - last if mistake == "− instead of +" else each + last
    if mistake != "ln B is forgotten":
        each = each + log_beta_function(alpha, beta)
    if mistake == "minus the entropy":
        each = -each
    return each.mean(-1) if mistake == "the mean over the variables" else each.sum(-1)
