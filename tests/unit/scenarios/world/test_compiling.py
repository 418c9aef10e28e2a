"""Whoever waits for the world to be compiled is told, and nobody else."""

import numba

from scenarios.world.compiling import told_when_compiling


def test_what_is_compiled_is_told_once_and_what_is_compiled_already_never() -> None:
    told: list[int] = []
    one, other = numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)
    with told_when_compiling(lambda: told.append(1)):
        assert told == []
        assert (one(1), other(1)) == (2, 3)
        assert told == [1]
    with told_when_compiling(lambda: told.append(2)):
        assert one(1) == 2
    numba.njit(lambda x: x + 3)(1)  # nobody waits any more
    assert told == [1]
