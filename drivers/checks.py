"""Result of one check of a device or of this machine, and the error for those that fail."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from drivers.errors import DeviceFault, GraspError, LinkLost

Finding = tuple[str, ...]  # status, detail and, unless the status is ok, remedy


class Check(NamedTuple):
    """Result of one check: status is ok, warn or fail; an ok has no remedy. ``kind`` is that of the
    error with which a run would end, unless it is a device fault."""

    name: str
    status: str
    detail: str
    remedy: str = ""
    kind: str = ""


def failed(name: str, error: Exception) -> Check:
    """The failed check for an error."""
    if isinstance(error, GraspError):
        return Check(name, "fail", error.message, error.remedy, error.kind)
    return Check(name, "fail", f"{type(error).__name__}: {error}", "see the message")


def checked(name: str, look: Callable[[], Finding]) -> Check:
    """The check's result; an exception becomes a failure."""
    try:
        return Check(name, *look())
    except Exception as error:  # a check reports every error
        return failed(name, error)


def failures(checks: Iterable[Check]) -> list[Check]:
    return [check for check in checks if check.status == "fail"]


def raise_failures(checks: Iterable[Check], where: str = "") -> None:
    """Raise for the checks that failed, all in one message: LinkLost if a device did not answer in
    one of them, else DeviceFault."""
    if not (found := failures(checks)):
        return
    lost = any(check.kind == LinkLost.kind for check in found)
    raise (LinkLost if lost else DeviceFault)(
        where + "; ".join(check.detail for check in found),
        "; ".join(dict.fromkeys(check.remedy for check in found if check.remedy)),
    )
