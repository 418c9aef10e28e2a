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
Settings = Annotated[dict[str, Scalar], Meta(description="what its package opens it with")]


class OwnDeviceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Devices of other packages in place of ours, by the names of their entry points."""

    gripper: Annotated[str, Meta(description="of grasp.grippers; empty: Robotiq 3-Finger")] = ""
    arm: Annotated[str, Meta(description="of grasp.arms; empty: Universal Robots")] = ""
    fingertips: Annotated[str, Meta(description="of grasp.fingertips; empty: TakkTile")] = ""
    gripper_settings: Settings = msgspec.field(default_factory=dict)
    arm_settings: Settings = msgspec.field(default_factory=dict)
    fingertips_settings: Settings = msgspec.field(default_factory=dict)

    def name(self, device: str) -> str:
        """Of the entry point; empty for a device of ours."""
        return {"gripper": self.gripper, "arm": self.arm, "fingertips": self.fingertips}[device]

    def settings(self, device: str) -> dict[str, Scalar]:
        own = (self.gripper_settings, self.arm_settings, self.fingertips_settings)
        return dict(zip(GROUPS, own, strict=True))[device]

    @property
    def chosen(self) -> dict[str, str]:
        """Names of those that are not ours, by device."""
        return {device: self.name(device) for device in GROUPS if self.name(device)}

    def called(self, device: str) -> str:
        """Its name and settings, in a word."""
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
    raises that is no error of ours. What closing it raises is logged."""
    check_offered(devices)
    name = devices.name(device)
    try:
        opened: AbstractContextManager[Any] = _offered(GROUPS[device])[name].load()(
            devices.settings(device), now
        )
        entered = opened.__enter__()
    except (GraspError, KeyboardInterrupt):
        raise
    except BaseException as error:  # its sys.exit(), or a task that was cancelled
        raise UsageError(
            f"{device} {name!r} of another package cannot be opened: {in_words(error)}",
            "ask its maintainers; docs/extending.md says what is expected of it",
        ) from error
    try:
        yield entered
    finally:
        try:
            opened.__exit__(None, None, None)
        except BaseException as error:
            logging.getLogger(__name__).warning(
                "%s %r does not let go: %s", device, name, in_words(error)
            )
            if isinstance(error, KeyboardInterrupt):
                raise
