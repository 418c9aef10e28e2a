"""What can go wrong in the emulated cell, by name, at once or later."""

import contextlib
import heapq
import threading
from collections import deque
from collections.abc import Callable, Sized
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from drivers.robotiq.emulator import GripperEmulator, Trouble, WireFault
from drivers.takktile.model.board import BoardModel
from drivers.ur.emulator.server import UrEmulator

MOST_WAITING = 1000  # faults that are to strike later, or for which a frozen arm has no time


class FaultOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One ``fault`` request: what goes wrong, when, and how much of it."""

    name: str
    after_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0  # from now on
    times: Annotated[int, Meta(ge=1)] = 1  # requests or reads that are hit
    skip: Annotated[int, Meta(ge=0)] = 0  # requests that are spared first
    seconds: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.1  # of a delay or a freeze
    code: Annotated[int, Meta(ge=0, le=15)] = 0x0E  # gripper fault; its default needs a reset
    pressed: bool = True  # emergency button
    on: bool = True  # remote control
    fraction: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.2  # of the speed slider


UNITS = {
    "after_s": "s from now, to 600", "times": "requests or reads hit",
    "skip": "requests spared first", "seconds": "s, to 60", "code": "0 to 15",
    "pressed": "true or false", "on": "true or false", "fraction": "0 to 1",
}  # fmt: skip
# name: the settings that it takes, and what it does
KNOWN: dict[str, tuple[tuple[str, ...], str]] = {
    "gripper_drop": (("times", "skip"), "requests get no reply"),
    "gripper_delay": (("times", "skip", "seconds"), "replies come later by so long"),
    "gripper_garble": (("times", "skip"), "replies are damaged"),
    "gripper_freeze": (("seconds", "skip"), "nothing is answered for so long, from a request on"),
    "gripper_disconnect": (("times",), "the connection is cut; with more, whoever connects again"),
    "gripper_fault": (
        ("code",),
        "this gFLT is reported; code=0 takes it back, but 13 to 15, which an activation ends",
    ),
    "unplug": ((), "the fingertips' board is off the USB bus, until replug"),
    "replug": ((), "the board is plugged in anew, stopped and without faults"),
    "usb_timeout": (("times",), "so many reads of the board bring nothing; replug ends it"),
    "protective_stop": ((), "the arm stops by its own safety system"),
    "emergency_stop": (
        ("pressed",),
        "the arm brakes and loses power; pressed=false releases the button, and its dashboard "
        "takes power on and brake release, from its next cycle on",
    ),
    "remote_control": (
        ("on",),
        "on=false: the pendant is turned to Local, e-Series alone; the program ends, none is taken",
    ),
    "speed_slider": (
        ("fraction",),
        "the arm's speed slider is turned: moves go on at that share of their pace",
    ),
    "arm_disconnect": ((), "the connections that are open to the arm are closed, if any"),
    "arm_freeze": (("seconds",), "the arm's controller does and answers nothing for so long"),
}


def in_words(name: str) -> str:
    """A fault, its settings with their defaults and units, and what it does."""
    settings, does = KNOWN[name]
    defaults = FaultOrder(name=name)
    told = (f"{each}={_shown(getattr(defaults, each))} ({UNITS[each]})" for each in settings)
    return f"{' '.join((name, *told))}: {does}"


def all_in_words() -> str:
    """Every fault, a line each."""
    later = f"each takes after_s=0 ({UNITS['after_s']}) too; what is given here are the defaults"
    return "\n".join((*map(in_words, KNOWN), later))


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


Strike = Callable[[FaultOrder], object]


class CellFaults:
    """Everything that can go wrong in a cell, by name; struck at once or at a later time."""

    def __init__(self, board: BoardModel, arm: UrEmulator, gripper: GripperEmulator | None) -> None:
        self._arm = arm
        self._table: dict[str, Strike] = {
            **({} if gripper is None else _gripper_faults(gripper)),
            "unplug": lambda order: board.unplug(),
            "replug": lambda order: board.replug(),
            "usb_timeout": lambda order: board.time_out(order.times),
        }
        self._arm_table: dict[str, Strike] = {
            "protective_stop": lambda order: arm.controller.protective_stop(),
            "emergency_stop": lambda order: arm.controller.emergency_stop(order.pressed),
            "remote_control": lambda order: arm.controller.set_remote_control(order.on),
            "speed_slider": lambda order: arm.controller.set_speed(order.fraction),
            "arm_disconnect": lambda order: arm.drop_links(),
            "arm_freeze": lambda order: arm.freeze(order.seconds),
        }
        self._waiting: list[tuple[int, int, FaultOrder]] = []  # a heap: when, and which came first
        self._ordered = 0
        self._for_arm: deque[FaultOrder] = deque()
        self._of_arm = threading.Condition()
        self._asked = self._done = 0  # of the arm

    def order(self, request: dict[str, Any], now_ns: int) -> str:
        """Take a request; what it will do, in words. Raises ValueError for an unknown name, an
        argument out of place, what this arm has not, and where too many are waiting."""
        name = str(request.get("name", ""))
        table = self._table | self._arm_table
        if name not in table:
            raise ValueError(f"unknown fault {name!r:.60}: one of {', '.join(table)}")
        known, does = KNOWN[name]
        if strange := request.keys() - {*known, "name", "after_s"}:
            raise ValueError(f"takes no {', '.join(sorted(strange)):.60}: {in_words(name)}")
        try:
            order = msgspec.convert(request, FaultOrder)
        except msgspec.ValidationError as error:
            raise ValueError(f"{error}: {in_words(name)}") from None
        if name == "remote_control":
            self._arm.controller.check_remote_control()
        if order.after_s:
            self._wait(order, now_ns)
        else:
            self._hit(order)
        when = f" in {order.after_s:g} s" if order.after_s else ""
        told = (f"{each}={_shown(getattr(order, each))}" for each in known)
        return f"{' '.join((name, *told))}{when}: {does}"

    def _wait(self, order: FaultOrder, now_ns: int) -> None:
        _check_room(self._waiting)
        self._ordered += 1
        when_ns = now_ns + round(order.after_s * 1e9)
        heapq.heappush(self._waiting, (when_ns, self._ordered, order))

    def strike(self, now_ns: int) -> None:
        """Let happen what is due; the caller holds the cell's lock."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            with contextlib.suppress(ValueError):  # too many: nobody is there to hear it
                self._hit(heapq.heappop(self._waiting)[2])

    def _hit(self, order: FaultOrder) -> None:
        if order.name in self._arm_table:
            _check_room(self._for_arm)
            self._asked += 1
            self._for_arm.append(order)
        else:
            self._table[order.name](order)

    def strike_arm(self) -> None:
        """What is due at the arm, whose controller and connections belong to its own thread."""
        while self._for_arm:
            order = self._for_arm.popleft()
            self._arm_table[order.name](order)
            with self._of_arm:
                self._done += 1
                self._of_arm.notify_all()

    def struck(self, seconds: float) -> bool:
        """Wait until all that was due at the arm by now has happened there; False where that takes
        longer. The caller must not hold the cell's lock, which the arm's thread needs."""
        asked = self._asked
        with self._of_arm:
            return self._of_arm.wait_for(lambda: self._done >= asked, seconds)


def _check_room(waiting: Sized) -> None:
    if len(waiting) >= MOST_WAITING:
        raise ValueError(f"{MOST_WAITING} faults are waiting: no more are taken")


def _gripper_faults(gripper: GripperEmulator) -> dict[str, Strike]:
    def plan(trouble: Trouble) -> Strike:
        return lambda order: gripper.faults.add(
            WireFault(trouble=trouble, times=order.times, skip=order.skip, seconds=order.seconds)
        )

    def disconnect(order: FaultOrder) -> None:
        """Once is a plug pulled and put back; more cuts whoever connects again."""
        gripper.disconnect()
        if order.times > 1:
            gripper.faults.add(WireFault(trouble=Trouble.DISCONNECT, times=order.times - 1))

    return {
        "gripper_drop": plan(Trouble.DROP),
        "gripper_delay": plan(Trouble.DELAY),
        "gripper_garble": plan(Trouble.GARBLE),
        "gripper_freeze": plan(Trouble.FREEZE),
        "gripper_disconnect": disconnect,
        "gripper_fault": lambda order: gripper.model.inject_fault(order.code),
    }
