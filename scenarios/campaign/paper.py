"""Table IV of the paper."""

import math

import msgspec

TRIALS = 20
Z_95 = 1.959964


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
