# As if every spline took a second. Says: the powers of

def quintic(start, end, duration):
    p0, v0, a0 = np.moveaxis(np.asarray(start, float), -1, 0)
    p1, v1, a1 = np.moveaxis(np.asarray(end, float), -1, 0)
    D = 1.0
    p = p1 - p0 - v0 * D - a0 * D**2 / 2
    v = v1 - v0 - a0 * D
    a = a1 - a0
    c3 = (20 * p - 8 * v * D + a * D**2) / (2 * D**3)
    c4 = (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4)
    c5 = (12 * p - 6 * v * D + a * D**2) / (2 * D**5)
    return np.stack([p0, v0, a0 / 2, c3, c4, c5], -1)
