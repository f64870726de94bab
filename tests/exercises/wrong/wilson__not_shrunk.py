# Without the division by 1 + z²/n. Says: Wilson

def wilson(count, total, z=1.96):
    p = count / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return [max(0.0, centre - margin), min(1.0, centre + margin)]
