# `or` of arrays. Says: truth value

def fallen(torso, standing_height):
    cos_tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
    return torso[..., 2] < 0.5 * standing_height or cos_tilt < math.cos(math.pi / 4)
