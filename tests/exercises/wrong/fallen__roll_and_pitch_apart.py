# 35° of both are 48° of tilt. Says: roll 35°, pitch 35°

def fallen(torso, standing_height):
    tilted = (np.abs(torso[..., 3:5]) > math.pi / 4).any(-1)
    return (torso[..., 2] < 0.5 * standing_height) | tilted
