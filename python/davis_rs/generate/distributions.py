"""Draws values from distributions, such that each is a function of seed, sequence and key."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from statistics import NormalDist

from .._util.array_types import JsonValue
from .._util.random_words import Words


class Distribution(ABC):
    """Stands in a plan in place of a value, which is drawn from it."""

    @abstractmethod
    def draw(self, words: Words) -> object:
        """Draw a value; of :class:`Choice` an option, in which there may be other distributions."""


@dataclass(frozen=True)
class Uniform(Distribution):
    """Draws a number between a and b, a < b: ``{uniform: [a, b]}``."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _check_bounds(self.low, self.high)

    def draw(self, words: Words) -> float:
        return words.uniform(self.low, self.high)


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Draws a number whose logarithm is uniform, 0 < a < b: ``{log_uniform: [a, b]}``."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _check_bounds(self.low, self.high)
        if self.low <= 0:
            raise ValueError(f"bounds must be > 0, got {self.low}")

    def draw(self, words: Words) -> float:
        low, high = math.log(self.low), math.log(self.high)
        return _within(math.exp(low + words.unit() * (high - low)), self.low, self.high)


@dataclass(frozen=True)
class Integers(Distribution):
    """Draws an integer from a to b, both of them possible, a < b: ``{integers: [a, b]}``."""

    low: int
    high: int

    def __post_init__(self) -> None:
        _check_bounds(self.low, self.high)

    def draw(self, words: Words) -> int:
        return self.low + words.below(self.high - self.low + 1)


@dataclass(frozen=True)
class Normal(Distribution):
    """Draws from the normal distribution, sigma > 0: ``{normal: [mean, sigma], min: a, max: b}``.

    Where min or max are given, it is cut off there: what lies outside is never drawn, not moved to the bound.
    """

    mean: float
    sigma: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma must be > 0, got {self.sigma}")
        _check_bounds(self.low, self.high)
        least, most, _ = self._tails()
        if not least < most:
            raise ValueError(f"nothing of the distribution lies in {self.low}..{self.high}")

    def draw(self, words: Words) -> float:
        least, most, sign = self._tails()
        fraction = least + words.unit() * (most - least)
        # Rounding may lead to a fraction of 0 or 1, whose quantile is infinite.
        fraction = min(max(fraction, 5e-324), 1 - 2.0**-53)
        return _within(self.mean + sign * self.sigma * NormalDist().inv_cdf(fraction), self.low, self.high)

    def _tails(self) -> tuple[float, float, int]:
        """Return the probability below each bound, and a sign.

        Above the mean they are those of the mirror image, with the sign -1, so that small ones keep their digits.
        """
        low, high, sign = (self.low - self.mean) / self.sigma, (self.high - self.mean) / self.sigma, 1
        if low > 0:
            low, high, sign = -high, -low, -1
        return _below(low), _below(high), sign


@dataclass(frozen=True)
class Choice(Distribution):
    """Draws one of the options: ``{choice: [x, y, ...], weights: [1, 2, ...]}``; without weights all are as likely.

    An option may hold distributions of its own.
    """

    options: tuple[object, ...]
    weights: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.options:
            raise ValueError("there must be an option")
        if self.weights and len(self.weights) != len(self.options):
            raise ValueError(f"there must be a weight for each of the {len(self.options)} options, got {self.weights}")
        if self.weights and (min(self.weights) < 0 or not 0 < sum(self.weights) < math.inf):
            raise ValueError(f"weights must be >= 0 and not all 0, got {self.weights}")

    def draw(self, words: Words) -> object:
        if not self.weights:
            return self.options[words.below(len(self.options))]
        sums: Sequence[float] = list(accumulate(self.weights))
        aim = words.unit() * sums[-1]
        # The last one with a weight, where rounding leads to the very end.
        last = max(index for index, weight in enumerate(self.weights) if weight > 0)
        return self.options[next((index for index, reached in enumerate(sums) if aim < reached), last)]


def draw(node: object, seed: int, index: int, path: str = "", words: Words | None = None) -> JsonValue:
    """Draw the value of a node of the plan in sequence ``index``; what is no distribution stays as it is.

    A distribution at ``path`` (``motion.speed_m_s``; an index into a list counts as a key) draws words of this path
    alone. One that is an option of a choice at the same path takes the words that follow the choice's.
    """
    if isinstance(node, Distribution):
        words = words or Words(seed, index, path)
        return draw(node.draw(words), seed, index, path, words)
    if isinstance(node, dict):
        return {key: draw(value, seed, index, f"{path}.{key}" if path else key) for key, value in node.items()}
    if isinstance(node, tuple):
        return [draw(value, seed, index, f"{path}.{item}") for item, value in enumerate(node)]
    return node


def _check_bounds(low: float, high: float) -> None:
    if not low < high:
        raise ValueError(f"the first bound must lie below the second one, got {low} and {high}")


def _below(x: float) -> float:
    """Return the cumulative distribution of the standard normal.

    It keeps its digits far below 0, where 1 + erf has none left.
    """
    return 0.5 * math.erfc(-x / math.sqrt(2))


def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
