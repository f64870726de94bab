# The ankle's roll is not taken out of the foot's rotation. Says: taken out of the foot's rotation

def leg_inverse(robot, position, foot_turn):
    thigh, shin = robot.thigh_length, robot.shin_length
    rx, ry, rz = np.moveaxis(np.einsum("...ji,...j->...i", foot_turn, -position), -1, 0)
    length = np.sqrt(rx**2 + ry**2 + rz**2)
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    ankle_roll = np.arctan2(ry, rz)
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    cos, sin = np.ones_like(length)[..., None], np.zeros_like(length)[..., None]
    m_y = cos * foot_turn[..., 1] - sin * foot_turn[..., 2]
    m_zz = sin[..., 0] * foot_turn[..., 2, 1] + cos[..., 0] * foot_turn[..., 2, 2]
    yaw = np.arctan2(-m_y[..., 0], m_y[..., 1])
    roll = np.arcsin(np.clip(m_y[..., 2], -1, 1))
    pitch = np.arctan2(-foot_turn[..., 2, 0], m_zz) - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)
