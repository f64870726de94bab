# A fall backward is none. Says: pitch -46°

def fallen(torso, standing_height):
    tilt = np.maximum(np.abs(torso[..., 3]), torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (tilt > math.pi / 4)
