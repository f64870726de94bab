# A cubic: no accelerations. Says: position, velocity, acceleration

def quintic(start, end, duration):
    p0, v0, _ = np.moveaxis(np.asarray(start, float), -1, 0)
    p1, v1, _ = np.moveaxis(np.asarray(end, float), -1, 0)
    D = duration
    c2 = 3 * (p1 - p0) / D**2 - (2 * v0 + v1) / D
    c3 = -2 * (p1 - p0) / D**3 + (v0 + v1) / D**2
    return np.stack([p0, v0, c2, c3, 0 * p0, 0 * p0], -1)
