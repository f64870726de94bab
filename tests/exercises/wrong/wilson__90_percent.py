# z of another interval. Says: 95 %

def wilson(count, total, z=1.96):
    z = 1.645
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return [max(0.0, (centre - margin) / shrink), min(1.0, (centre + margin) / shrink)]
