"""Table IV of the paper, and how well a model of it explains it."""

import itertools
import math
from collections.abc import Iterator, Sequence

import msgspec

TRIALS = 20
Z_95 = 1.959964
PRIOR = 0.5  # Jeffreys: what a class counts for before the model has been run


class PaperCell(msgspec.Struct, frozen=True):
    """Successes of twenty (paper, table IV); a long object's lifts split at 6 and 12 cm."""

    tap: int
    near: int  # lift, within 6 cm; of the other objects: held
    far: int = 0  # lift, 6 to 12 cm

    @property
    def lift(self) -> int:
        return self.near + self.far


TABLE_IV = {
    "ball": PaperCell(18, 7),
    "box": PaperCell(17, 20),
    "cardboard": PaperCell(18, 9, 8),
    "football": PaperCell(18, 17),
    "foam": PaperCell(16, 7),
    "can": PaperCell(18, 15, 4),
}
LONG = ("box", "cardboard", "can")


def wilson(successes: int, n: int) -> tuple[float, float]:
    """95 % score interval of a proportion (Wilson 1927); 0 to 1 without trials."""
    if n == 0:
        return 0.0, 1.0
    p, z2 = successes / n, Z_95**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z_95 / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return max(0.0, middle - half), min(1.0, middle + half)


def log_multinomial(counts: Sequence[int]) -> float:
    """Log probability of the counts under their own frequencies: the best that any model can."""
    n = sum(counts)
    log_ways = math.lgamma(n + 1) - sum(math.lgamma(k + 1) for k in counts)
    return log_ways + sum(k * math.log(k / n) for k in counts if k)


def log_predictive(counts: Sequence[int], model: Sequence[int]) -> float:
    """Log probability of the counts where the model, run, gave these counts of each class.

    Dirichlet-multinomial with Jeffreys' prior: a model that was run a hundred times is not sure of
    its own probabilities, and a class that it never reached is rare, not impossible.
    """
    n = sum(counts)
    weights = [k + PRIOR for k in model]
    total = sum(weights)
    out = math.lgamma(n + 1) + math.lgamma(total) - math.lgamma(n + total)
    for k, a in zip(counts, weights, strict=True):
        out += math.lgamma(k + a) - math.lgamma(a) - math.lgamma(k + 1)
    return out


def p_value(counts: Sequence[int], model: Sequence[int]) -> float:
    """Probability, under the model, of an outcome no more likely than these counts."""
    n, bound = sum(counts), log_predictive(counts, model) + 1e-9
    scores = (log_predictive(each, model) for each in _splits(n, len(counts)))
    return min(1.0, sum(math.exp(score) for score in scores if score <= bound))


def _splits(n: int, classes: int) -> Iterator[tuple[int, ...]]:
    """Every way to put n trials into so many classes."""
    for cuts in itertools.combinations_with_replacement(range(n + 1), classes - 1):
        edges = (0, *cuts, n)
        yield tuple(b - a for a, b in itertools.pairwise(edges))


def paper_counts(scenario: str, name: str) -> tuple[int, ...]:
    """The paper's counts by class: near, far and failed for a long object's lift, else two."""
    cell = TABLE_IV[name]
    if scenario == "tap":
        return cell.tap, TRIALS - cell.tap
    if name in LONG:
        return cell.near, cell.far, TRIALS - cell.lift
    return cell.lift, TRIALS - cell.lift
