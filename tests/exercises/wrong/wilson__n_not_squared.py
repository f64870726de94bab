# z²/4n instead of z²/4n². Says: 4n²

def wilson(count, total, z=1.96):
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total))
    return [max(0.0, (centre - margin) / shrink), min(1.0, (centre + margin) / shrink)]
