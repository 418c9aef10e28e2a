"""Colours of detectors in charts."""

from collections.abc import Iterable, Iterator
from itertools import cycle
from typing import TypeVar

COLOURS = ("#1f5f99", "#c2571a", "#3a7d44", "#7a4fa3", "#b00020", "#777777", "#a8862b", "#21a0a0")

T = TypeVar("T")


def in_colour(every: Iterable[T]) -> Iterator[tuple[T, str]]:
    """Each with its colour, which come again where there are more of them: none is left out."""
    return zip(every, cycle(COLOURS), strict=False)
