# p ± z·√(p(1−p)/n): no width at 0 and 1. Says: Wilson

def wilson(count, total, z=1.96):
    p = count / total
    margin = z * math.sqrt(p * (1 - p) / total)
    return [max(0.0, p - margin), min(1.0, p + margin)]
