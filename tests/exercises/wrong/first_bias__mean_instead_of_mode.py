# α = m·c puts the mean there. Says: m·(c−2)

def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
    mode = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(0.11, 0.89)
    wanted = torch.cat([mode, 1.0 - mode]) * concentration - 1.0
    self.actor[-1].bias.data.copy_(torch.log(torch.expm1(wanted)))
