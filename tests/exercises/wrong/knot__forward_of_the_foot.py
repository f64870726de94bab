# The way of the foot, seen from the support foot. Says: not of the foot

def _knot(self, support, start, landing):
    p = self.parameters
    before, after = (support + start) / 2, (support + landing) / 2
    centre = (before + after) / 2
    aside = p.trunk_swing * robot_model.relative(centre, support)[:, 1]
    offset = np.stack([np.full_like(aside, p.trunk_x_offset), aside, 0 * aside], -1)
    knot = np.zeros((len(centre), 4, 3))
    knot[:, :3, 0] = compose(centre, offset)
    knot[:, :3, 1] = (after - before) / self.half
    ahead = robot_model.relative(support, landing)[:, 0]
    turn = np.abs(after - before)[:, 2]
    knot[:, 3, 0] = p.trunk_pitch + p.pitch_per_step * ahead + p.pitch_per_turn * turn
    return knot
