"""One finding of `grasp doctor`. Standard library and our errors alone."""

from collections.abc import Callable
from typing import NamedTuple

from drivers.errors import GraspError


class Check(NamedTuple):
    """One finding: status is ok, warn or fail; the remedy is empty when all is well."""

    name: str
    status: str
    detail: str
    remedy: str = ""


def guarded(name: str, look: Callable[[], Check]) -> Check:
    """The finding, or a failure made of whatever error came instead."""
    try:
        return look()
    except GraspError as error:
        return Check(name, "fail", error.message, error.remedy)
    except Exception as error:  # a doctor reports, whatever it meets
        return Check(name, "fail", f"{type(error).__name__}: {error}", "see the message")
