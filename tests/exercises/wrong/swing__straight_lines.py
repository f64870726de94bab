# Moves at a constant speed. Says: at rest

def _swing(self, start, landing):
    wait = self.parameters.double_support * self.half
    swing = self.half - wait
    t = np.arange(self.half_ticks + 1) * self.robot.control_dt
    t = np.clip(t - wait, 0, swing)
    foot = np.zeros((len(start), len(t), 4))
    foot[..., [0, 1, 3]] = start[:, None] + (t / swing)[:, None] * (landing - start)[:, None]
    up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], swing / 2)
    foot[..., 2] = polynomial(up, np.minimum(t, swing - t))
    return foot
