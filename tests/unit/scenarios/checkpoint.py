"""Checkpoints of a lift at the first step of each phase, made once and copied for every test."""

# ruff: noqa: SLF001
import copy
import copyreg
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from drivers.takktile.model.link import ModelLink, ModelUsb
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.rigs.rig import GraspRig
from scenarios.trial import execution

# rig, loop, controller and trace share objects, so they are copied together
Parts = tuple[Any, ...]
Kept = dict[State, tuple[Parts, list[Tick]]]
_kept: dict[tuple[str, int], Kept] = {}

for _lock in (threading.Lock, threading.RLock):
    copyreg.pickle(type(_lock()), lambda _, make=_lock: (make, ()))  # type: ignore[misc]


def kept(digest: str, seed: int) -> Kept:
    """Checkpoints by phase of the lift with these settings; empty before its first run."""
    return _kept.setdefault((digest, seed), {})


def _array(array: Any, memo: dict[int, Any]) -> Any:
    """A copy of an array; a view becomes a view of the copied base."""
    base = array.base
    if not isinstance(base, np.ndarray):
        return array.copy()
    offset = array.ctypes.data - base.ctypes.data
    return np.ndarray(array.shape, array.dtype, copy.deepcopy(base, memo), offset, array.strides)


def copied(parts: Parts) -> Parts:
    """An independent copy of the parts."""
    on_tick, parts[1]._on_tick = parts[1]._on_tick, None
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(copy._deepcopy_dispatch, np.ndarray, _array)  # type: ignore[attr-defined]
        made: Parts = copy.deepcopy(parts)
    parts[1]._on_tick, made[1]._on_tick = on_tick, lambda tick: None
    link: ModelLink = made[0].tactile._link  # its functions still refer to the original
    link.receiver._connect = lambda serial: ModelUsb(link._model)
    link.receiver._clock = lambda: link._now_ns
    return made


@contextmanager
def parts_of(rig: GraspRig) -> Iterator[Callable[[], Parts]]:
    """Context in which the returned function gives the parts of the running trial."""
    made: dict[str, Any] = {}

    def noted(name: str) -> Callable[..., Any]:
        make = getattr(execution, name)

        def call(*args: Any, **more: Any) -> Any:
            made[name] = make(*args, **more)
            return made[name]

        return call

    with pytest.MonkeyPatch.context() as patch:
        for name in ("make_loop", "make_controller", "Trace"):
            patch.setattr(execution, name, noted(name))
        yield lambda: (rig, made["make_loop"], made["make_controller"], made["Trace"])


@contextmanager
def resumed(parts: Parts) -> Iterator[GraspRig]:
    """Context in which the next trial on this rig continues from the checkpoint."""
    rig, loop, controller, trace = parts

    def make_loop(*args: Any) -> Any:
        loop._on_tick = args[4]
        return loop

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execution, "make_loop", make_loop)
        patch.setattr(execution, "make_controller", lambda *_: controller)
        patch.setattr(execution, "Trace", lambda: trace)
        yield rig
