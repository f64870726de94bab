# No γ before V(s'). Says: r + γ·V(s')

def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    bootstrap = torch.where(terminated, torch.zeros_like(next_values), next_values)
    deltas = rewards + bootstrap - values
    goes_on = 1.0 - (terminated | truncated).to(rewards.dtype)
    advantages = torch.zeros_like(rewards)
    later = torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        later = deltas[t] + gamma * lam * goes_on[t] * later
        advantages[t] = later
    return advantages
