"""Exercises whose functions no stage has, graded against independent truth."""

from importlib import import_module

import numpy as np
import pytest
import torch
from checks import close
from numpy.random import default_rng

exercise = import_module("beta")  # tests/course/beta.py, or a student's
SHAPES = [(1.0, 1.0), (2.0, 5.0), (4.5, 1.2), (30.0, 60.0), (1.0, 3.0), (200.0, 300.0)]


@torch.inference_mode()
def given(*lists, dtype=torch.float64):
    """A tensor for each, which cannot be written to."""
    return [torch.tensor(numbers, dtype=dtype) for numbers in lists]


def some_shapes():
    """α and β of four times three variables, and their distribution by PyTorch."""
    a, b = given(*default_rng(0).uniform(1, 6, (2, 4, 3)))
    return a, b, torch.distributions.Beta(a, b)


@pytest.fixture
def alone(monkeypatch):
    """PyTorch's own distributions are the judge, not the solution."""

    def refuse(*_):
        pytest.fail("write the formula out: torch.distributions is the judge")

    for kind in torch.distributions.Beta, torch.distributions.Dirichlet:
        for name in "log_prob", "entropy":
            monkeypatch.setattr(kind, name, refuse)
        monkeypatch.setattr(kind, "mode", property(refuse))


@pytest.mark.parametrize("a, b", SHAPES)
def test_beta_density_integrates_to_one(alone, a, b):
    x = torch.linspace(0, 1, 20_001, dtype=torch.float64)[1:-1, None]
    log_p = exercise.beta_log_prob(x, torch.full_like(x, a), torch.full_like(x, b))
    assert log_p.shape == x.shape[:1], "a number for each row of variables, see the other test"
    area = log_p.exp().sum().item() / 20_000
    close(
        area,
        1.0,
        "the area below p(x) must be 1: is ln B(α, β) wrong, or its sign, or a term? (nan: Γ itself "
        "is too large for a float)",
        atol=2e-3,
    )


def test_beta_log_prob_sums_over_the_variables():
    a, b, truth = some_shapes()
    x = torch.linspace(0.05, 0.95, 12, dtype=torch.float64).reshape(4, 3)
    got = exercise.beta_log_prob(x, a, b)
    assert got.shape == (4,), "one number for all k variables of a row: their SUM over axis −1"
    close(
        got,
        truth.log_prob(x).sum(-1),
        "ln p of independent variables is the SUM (not the mean) of theirs: (α−1)·ln x + "
        "(β−1)·ln(1−x) − ln B(α, β); are α and β, x and 1 − x in their places?",
        atol=1e-5,
        rtol=1e-5,
    )


def test_beta_entropy_sums_over_the_variables():
    a, b, truth = some_shapes()
    got = exercise.beta_entropy(a, b)
    assert got.shape == (4,), "one number for all k variables of a row: their SUM over axis −1"
    close(
        got,
        truth.entropy().sum(-1),
        "the SUM over the variables (not the mean) of the equation; compare every sign; ψ is the "
        "DIgamma function, the derivative of ln Γ",
        atol=1e-5,
        rtol=1e-5,
    )


def test_beta_entropy_of_the_uniform_distribution_is_zero(alone):
    flat = torch.ones(1, 1, dtype=torch.float64)
    assert abs(exercise.beta_entropy(flat, flat).item()) < 1e-6, "uniform: the entropy is 0"


@pytest.mark.parametrize("a, b", SHAPES[1:])
def test_beta_mode_is_where_the_density_is_largest(a, b):
    x = torch.linspace(0, 1, 10_001, dtype=torch.float64)[1:-1, None]
    a, b = given([a], [b])
    best = x[torch.distributions.Beta(a, b).log_prob(x).argmax()].item()
    close(
        exercise.beta_mode(a, b).item(),
        best,
        "mode = (α−1)/(α+β−2): α belongs to x, β to 1 − x; α/(α+β) would be the mean",
        atol=2e-4,
    )


def test_beta_mode_stays_inside_where_the_formula_is_nearly_zero_by_zero(alone):
    tiny = np.float32(2.0**-23)
    a, b = given([1.0, 1.0 + tiny, 1.0], [1.0, 1.0, 1.0 + tiny], dtype=torch.float32)
    close(
        exercise.beta_mode(a, b),
        [0.5, 1.0, 0.0],
        "α + β − 2 loses the digits that α − 1 and β − 1 still have; and 0/0 is 0.5 here",
        rtol=1e-6,
    )
