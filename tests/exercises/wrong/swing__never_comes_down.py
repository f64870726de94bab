# Rises during all of the swing. Says: lands at height 0

def _swing(self, start, landing):
    wait = self.parameters.double_support * self.half
    swing = self.half - wait
    t = np.arange(self.half_ticks + 1) * self.robot.control_dt
    t = np.clip(t - wait, 0, swing)
    zero = np.zeros_like(start)
    begin, end = (np.stack([pose, zero, zero], -1) for pose in (start, landing))
    foot = np.zeros((len(start), len(t), 4))
    foot[..., [0, 1, 3]] = polynomial(quintic(begin, end, swing), t).swapaxes(1, 2)
    up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], swing)
    foot[..., 2] = polynomial(up, t)
    return foot
