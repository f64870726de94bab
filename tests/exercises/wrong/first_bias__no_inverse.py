# softplus is not undone. Says: softplus⁻¹

def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
    mode = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(0.01, 0.99)
    wanted = torch.cat([mode, 1.0 - mode]) * (concentration - 2.0)
    self.actor[-1].bias.data.copy_(wanted)
