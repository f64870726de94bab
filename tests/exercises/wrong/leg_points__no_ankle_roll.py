# The ankle's roll is forgotten. Says: the ankle's roll?

def leg_points(robot, joints):
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(np.asarray(joints), -1, 0)
    zero = np.zeros_like(yaw)
    hip_turn = rotation(roll, zero, yaw)
    pitches = pitch, pitch + knee, pitch + knee + ankle_pitch
    thigh_turn, shin_turn, flat_turn = (hip_turn @ rotation(zero, p, zero) for p in pitches)
    foot_turn = flat_turn
    knee_point = -robot.thigh_length * thigh_turn[..., 2]
    ankle = knee_point - robot.shin_length * shin_turn[..., 2]
    heel = ankle + foot_turn @ np.array([-robot.foot_back, 0, -robot.ankle_height])
    toe = ankle + foot_turn @ np.array([robot.foot_front, 0, -robot.ankle_height])
    return np.stack([0 * ankle, knee_point, ankle, heel, toe], -2), foot_turn
