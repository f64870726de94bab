# For one axis, no batch. Says: values to unpack

def quintic(start, end, duration):
    (p0, v0, a0), (p1, v1, a1), D = start, end, duration
    p, v, a = p1 - p0 - v0 * D - a0 * D**2 / 2, v1 - v0 - a0 * D, a1 - a0
    return np.array([p0, v0, a0 / 2, (20 * p - 8 * v * D + a * D**2) / (2 * D**3),
                     (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4),
                     (12 * p - 6 * v * D + a * D**2) / (2 * D**5)])
