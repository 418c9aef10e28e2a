"""One finding of `grasp doctor`. Standard library and our errors alone."""

from collections.abc import Callable
from typing import NamedTuple

from drivers.errors import GraspError

Finding = tuple[str, ...]  # status and what was found; the remedy where all is not well


class Check(NamedTuple):
    """One finding: status is ok, warn or fail; the remedy is empty when all is well. ``kind``: of
    the error that a run would end with, where that is no fault of a device."""

    name: str
    status: str
    detail: str
    remedy: str = ""
    kind: str = ""


def checked(name: str, look: Callable[[], Finding]) -> Check:
    """The finding, or a failure made of whatever error came instead."""
    try:
        return Check(name, *look())
    except GraspError as error:
        return Check(name, "fail", error.message, error.remedy, error.kind)
    except Exception as error:  # a doctor reports, whatever it meets
        return Check(name, "fail", f"{type(error).__name__}: {error}", "see the message")
