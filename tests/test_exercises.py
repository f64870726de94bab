"""Exercises whose functions no stage has, graded against independent truth."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent / "exercises"))
exercise = import_module("beta")
SHAPES = [(1.0, 1.0), (2.0, 5.0), (4.5, 1.2), (30.0, 60.0), (1.0, 3.0)]

@pytest.mark.parametrize("a, b", SHAPES)
def test_beta_density_integrates_to_one(a, b):
    x = torch.linspace(0, 1, 20_001, dtype=torch.float64)[1:-1, None]
    log_p = exercise.beta_log_prob(x, torch.full_like(x, a), torch.full_like(x, b))
    area = log_p.exp().sum().item() / 20_000
    assert area == pytest.approx(1.0, abs=2e-3), "the normalisation B(α, β) is wrong"

def test_joint_log_prob_and_entropy_sum_over_the_variables():
    rng = torch.Generator().manual_seed(0)
    a, b = 1 + 5 * torch.rand(2, 4, 3, generator=rng, dtype=torch.float64)
    x = torch.rand(4, 3, generator=rng, dtype=torch.float64)
    truth = torch.distributions.Beta(a, b)
    got = exercise.beta_log_prob(x, a, b)
    assert got.shape == (4,), "one number for all k variables of a row: their SUM, not the mean"
    torch.testing.assert_close(got, truth.log_prob(x).sum(-1))
    torch.testing.assert_close(exercise.beta_entropy(a, b), truth.entropy().sum(-1))
    flat = torch.ones(1, 1, dtype=torch.float64)
    assert abs(exercise.beta_entropy(flat, flat).item()) < 1e-12, "uniform: the entropy is 0"

@pytest.mark.parametrize("a, b", SHAPES[1:])
def test_beta_mode_is_where_the_density_is_largest(a, b):
    x = torch.linspace(0, 1, 10_001, dtype=torch.float64)[1:-1, None]
    a, b = torch.tensor([a], dtype=torch.float64), torch.tensor([b], dtype=torch.float64)
    best = x[torch.distributions.Beta(a, b).log_prob(x).argmax()].item()
    assert exercise.beta_mode(a, b).item() == pytest.approx(best, abs=2e-4), (
        "mode = (α−1)/(α+β−2); α/(α+β) would be the mean")

def test_beta_mode_stays_inside_where_the_formula_is_nearly_zero_by_zero():
    tiny = np.float32(2.0**-23)
    a, b = torch.tensor([1.0, 1.0 + tiny, 1.0]), torch.tensor([1.0, 1.0, 1.0 + tiny])
    np.testing.assert_allclose(exercise.beta_mode(a, b), [0.5, 1.0, 0.0], err_msg=(
        "α + β − 2 loses the digits that α − 1 and β − 1 still have; and 0/0 is 0.5 here"))
