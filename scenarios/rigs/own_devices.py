"""Grippers, arms and fingertips that other packages offer by entry points.

An entry point is a function of the settings for it and of a clock (nanoseconds, monotonic); it
gives a context manager of what keeps to a protocol of `drivers.interfaces`, connected inside. Such
a device counts as real, whatever it is: it is opened on the rig `hardware` alone.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from drivers.errors import ConfigError, GraspError, UsageError, in_words

Scalar = bool | int | float | str
GROUPS = {"gripper": "grasp.grippers", "arm": "grasp.arms", "fingertips": "grasp.fingertips"}
Opened = AbstractContextManager[Any]


class OwnDeviceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Devices of other packages in place of ours, by the names of their entry points."""

    gripper: Annotated[str, Meta(description="empty: Robotiq 3-Finger; else of grasp.grippers")] = (
        ""
    )
    arm: Annotated[str, Meta(description="empty: Universal Robots; else of grasp.arms")] = ""
    fingertips: Annotated[str, Meta(description="empty: TakkTile; else of grasp.fingertips")] = ""
    gripper_settings: Annotated[
        dict[str, Scalar], Meta(description="what it is opened with, as its package says")
    ] = msgspec.field(default_factory=dict)
    arm_settings: Annotated[dict[str, Scalar], Meta(description="likewise")] = msgspec.field(
        default_factory=dict
    )
    fingertips_settings: Annotated[dict[str, Scalar], Meta(description="likewise")] = msgspec.field(
        default_factory=dict
    )

    def name(self, device: str) -> str:
        """Of the entry point; empty for a device of ours."""
        return {"gripper": self.gripper, "arm": self.arm, "fingertips": self.fingertips}[device]

    def settings(self, device: str) -> dict[str, Scalar]:
        """What it is opened with."""
        return {
            "gripper": self.gripper_settings,
            "arm": self.arm_settings,
            "fingertips": self.fingertips_settings,
        }[device]

    @property
    def chosen(self) -> dict[str, str]:
        """Names of those that are not ours, by device."""
        return {device: self.name(device) for device in GROUPS if self.name(device)}

    def called(self, device: str) -> str:
        """Which one is meant, in a word: its name and settings."""
        given = ",".join(f"{key}={value}" for key, value in sorted(self.settings(device).items()))
        return f"{self.name(device)}({given})"


@cache
def _offered(group: str) -> dict[str, EntryPoint]:
    return {each.name: each for each in entry_points(group=group)}


def check_offered(devices: OwnDeviceSettings) -> None:
    """Raises ConfigError for a name that no installed package offers."""
    for device, name in devices.chosen.items():
        known = _offered(GROUPS[device])
        if name not in known:
            offers = ", ".join(known) or f"none is installed (entry points {GROUPS[device]})"
            raise ConfigError("devices", device, f"unknown: {name!r}", offers)


@contextmanager
def own_device(devices: OwnDeviceSettings, device: str, now: Callable[[], int]) -> Iterator[Any]:
    """It, connected. Raises ConfigError for an unknown name, and UsageError for what its package
    raises that is no error of ours."""
    check_offered(devices)
    name = devices.name(device)
    try:
        opened: Opened = _offered(GROUPS[device])[name].load()(devices.settings(device), now)
        entered = opened.__enter__()
    except GraspError:
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # its sys.exit(), or a task that was cancelled
        raise UsageError(
            f"{device} {name!r} of another package cannot be opened: {in_words(error)}",
            "ask its maintainers; docs/extending.md says what is expected of it",
        ) from error
    try:
        yield entered
    finally:
        _let_go(opened, f"{device} {name!r}")


def _let_go(opened: Opened, who: str) -> None:
    """What it raises costs no result and hides no error; it is told."""
    try:
        opened.__exit__(None, None, None)
    except BaseException as error:
        logging.getLogger(__name__).warning("%s does not let go: %s", who, in_words(error))
        if isinstance(error, KeyboardInterrupt):
            raise
