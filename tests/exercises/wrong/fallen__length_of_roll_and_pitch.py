# 32° of both are 44° of tilt, not 45.3°. Says: roll 32°, pitch 32°

def fallen(torso, standing_height):
    tilt = np.hypot(torso[..., 3], torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (tilt > math.pi / 4)
