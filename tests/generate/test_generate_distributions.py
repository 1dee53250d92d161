"""The distributions of a plan: their range, their shape, and what a draw depends on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from davis_rs._util.random_words import Words
from davis_rs.generate.distributions import Choice, Distribution, Integers, LogUniform, Normal, Uniform, draw

finite = st.floats(-1e6, 1e6)


def draws(distribution: Distribution, count: int = 4000, path: str = "key") -> list[Any]:
    return [draw(distribution, 5, index, path) for index in range(count)]


def test_words_are_the_same_for_ever() -> None:
    """SHA-256 of seed/index/path/number: a plan gives the same data sets on every machine, in every later version."""
    words = Words(7, 3, "motion.speed_m_s")
    assert [words.word(), words.word()] == [11378536561253543442, 5435594081436461154]


@given(st.integers(0), st.integers(0), st.text(max_size=5))
def test_units_lie_inside(seed: int, index: int, path: str) -> None:
    """Neither 0 nor 1 ever, so that every quantile is finite."""
    assert 0 < Words(seed, index, path).unit() < 1


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (Uniform(-2, 3), stats.uniform(-2, 5)),
        (LogUniform(0.01, 10), stats.loguniform(0.01, 10)),
        (Normal(4, 2), stats.norm(4, 2)),
        (Normal(4, 2, low=3, high=9), stats.truncnorm(-0.5, 2.5, 4, 2)),
        (Normal(0, 1, low=9), stats.truncnorm(9, np.inf)),
        (Normal(0, 1, high=-30), stats.truncnorm(-np.inf, -30)),
    ],
    ids=lambda one: repr(one) if isinstance(one, Distribution) else "",
)
def test_a_law_has_its_distribution(distribution: Distribution, expected: Any) -> None:
    """Kolmogorov and Smirnov's test over sequences; also far out in a tail, where shares are tiny."""
    assert stats.kstest(draws(distribution), expected.cdf).pvalue > 0.01


def test_integers_reach_both_ends_alike() -> None:
    """The bounds belong to the distribution, as in a die's 1..6."""
    values, counts = np.unique(draws(Integers(1, 6), 6000), return_counts=True)
    assert values.tolist() == [1, 2, 3, 4, 5, 6]
    assert stats.chisquare(counts).pvalue > 0.01


def test_choices_follow_their_weights() -> None:
    """Shares of the weights' sum; an option of weight 0 never comes."""
    drawn = draws(Choice(("a", "b", "c"), (1, 0, 3)), 4000)
    assert "b" not in drawn
    assert stats.binomtest(drawn.count("c"), 4000, 0.75).pvalue > 0.01
    assert stats.chisquare(np.unique(draws(Choice(("a", "b", "c")), 3000), return_counts=True)[1]).pvalue > 0.01


def test_a_law_within_a_choice_is_independent_of_the_choice() -> None:
    """It stands at the same key path, and must not draw the same words again."""
    distribution = Choice((0.0, Uniform(1, 2), Choice((5.0, Uniform(3, 4)))))
    drawn = np.array(draws(distribution, 9000))
    for low in (1, 3):
        inside = drawn[(drawn > low) & (drawn < low + 1)]
        assert len(inside) > 1000
        assert stats.kstest(inside, stats.uniform(low, 1).cdf).pvalue > 0.01


@given(st.integers(0, 2**64), st.integers(0, 10**6), finite, finite, st.floats(1e-3, 1e3))
def test_draws_stay_in_their_bounds(seed: int, index: int, a: float, b: float, sigma: float) -> None:
    """Whatever rounding does."""
    low, high = sorted((a, b))
    assume(low < high)
    words = Words(seed, index, "x")
    assert low <= Uniform(low, high).draw(words) <= high
    assert math.floor(low) <= Integers(math.floor(low), math.floor(high) + 1).draw(words) <= math.floor(high) + 1
    if low > 0:
        assert low <= LogUniform(low, high).draw(words) <= high
    if stats.norm(0, sigma).cdf(high) - stats.norm(0, sigma).cdf(low) > 0:
        assert low <= Normal(0.0, sigma, low, high).draw(words) <= high


@given(st.permutations(["a", "b", "c", "d"]), st.sets(st.sampled_from(["a", "b", "c", "d"]), min_size=1))
def test_a_draw_depends_on_its_path_alone(order: list[str], kept: set[str]) -> None:
    """Other keys, their order and what surrounds them change nothing; another index, seed or path does."""
    distributions: dict[str, Any] = {
        "a": Uniform(0, 1),
        "b": {"c": Normal(0, 1), "d": (Uniform(0, 1), Uniform(0, 1))},
        "c": Choice((1, {"e": Uniform(0, 1)})),
        "d": 3,
    }
    whole = draw(distributions, 1, 2)
    some = draw({key: distributions[key] for key in order if key in kept}, 1, 2)
    assert some == {key: whole[key] for key in kept}
    assert len({draw(Uniform(0, 1), *at) for at in ((1, 2, "a"), (1, 3, "a"), (2, 2, "a"), (1, 2, "b"))}) == 4
    assert whole["b"]["d"][0] != whole["b"]["d"][1]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Uniform(2, 2), "first bound must lie below the second one, got 2 and 2"),
        (lambda: LogUniform(0, 1), "bounds must be > 0, got 0"),
        (lambda: Integers(3, 1), "first bound must lie below the second one, got 3 and 1"),
        (lambda: Normal(0, 0), "sigma must be > 0, got 0"),
        (lambda: Normal(0, 1, 50, 60), "nothing of the distribution lies in 50..60"),
        (lambda: Choice(()), "there must be an option"),
        (lambda: Choice((1, 2), (1,)), "a weight for each of the 2 options"),
        (lambda: Choice((1, 2), (0, 0)), "not all 0"),
        (lambda: Choice((1, 2), (-1, 2)), "weights must be >= 0"),
    ],
)
def test_impossible_laws_are_refused(make: Any, message: str) -> None:
    """When the plan is read, not when the first value is drawn."""
    with pytest.raises(ValueError, match=message):
        make()
