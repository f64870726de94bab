# π_old in the order of the rollout. Says: of the same `pick`

def improve(model, optimizer, data, cfg):
    advantages, targets, old_log_prob = judge(model, data, cfg)
    obs, action = data["obs"].flatten(0, 1), data["action"].flatten(0, 1)
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean()
        left = (targets - model.value(obs)).var() / targets.var()
        before = {"entropy": entropy.item(), "explained_variance": 1.0 - left.item()}
    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):
            log_prob = model.policy(obs[pick]).log_prob(action[pick])
            ratio = (log_prob - old_log_prob[: len(pick)]).exp()
            a = advantages[pick]
            a = (a - a.mean()) / (a.std(correction=0) + 1e-8)
            critic_loss = ((model.value(obs[pick]) - targets[pick]) ** 2).mean()
            loss = -clipped_objective(ratio, a, cfg.clip).mean() + cfg.value_coef * critic_loss
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()
    with torch.no_grad():
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob
        outside = ((log_ratio.exp() - 1).abs() > cfg.clip).float()
        return {**before, "clip_fraction": outside.mean().item(),
                "approx_kl": (torch.expm1(log_ratio) - log_ratio).mean().item(),
                "value_loss": ((model.value(obs) - targets) ** 2).mean().item()}
