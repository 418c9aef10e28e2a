"""What can go wrong in the emulated cell, by name, at once or later."""

import heapq
import threading
from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta

from drivers.robotiq.emulator import GripperEmulator, Trouble, WireFault
from drivers.takktile.model.board import BoardModel
from drivers.ur.emulator.server import UrEmulator


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


class Known(NamedTuple):
    """A fault: the device (board, arm or gripper) that it strikes, the settings that it takes, what
    happens, and how."""

    device: str
    takes: str
    does: str
    strike: Callable[[Any, FaultOrder], object]

    @property
    def settings(self) -> list[str]:
        return self.takes.split()


def _on_wire(trouble: Trouble) -> Callable[[GripperEmulator, FaultOrder], object]:
    return lambda gripper, order: gripper.faults.add(
        WireFault(trouble=trouble, times=order.times, skip=order.skip, seconds=order.seconds)
    )


def _disconnect(gripper: GripperEmulator, order: FaultOrder) -> None:
    gripper.disconnect()
    if order.times > 1:
        gripper.faults.add(WireFault(trouble=Trouble.DISCONNECT, times=order.times - 1))


_AFTER = "pressed=false releases the button, and its dashboard takes power on and brake release"
KNOWN = {
    "gripper_drop": Known("gripper", "times skip", "requests get no reply", _on_wire(Trouble.DROP)),
    "gripper_delay": Known("gripper", "times skip seconds", "replies come later by so long",
        _on_wire(Trouble.DELAY)),
    "gripper_garble": Known("gripper", "times skip", "replies are damaged",
        _on_wire(Trouble.GARBLE)),
    "gripper_freeze": Known("gripper", "seconds skip",
        "nothing is answered for so long, from a request on", _on_wire(Trouble.FREEZE)),
    "gripper_disconnect": Known("gripper", "times",
        "the connection is cut; with more, whoever connects again", _disconnect),
    "gripper_fault": Known("gripper", "code",
        "this gFLT is reported; code=0 takes it back, but 13 to 15, which an activation ends",
        lambda gripper, order: gripper.model.inject_fault(order.code)),
    "unplug": Known("board", "", "the fingertips' board is off the USB bus, until replug",
        lambda board, order: board.unplug()),
    "replug": Known("board", "", "the board is plugged in anew, stopped and without faults",
        lambda board, order: board.replug()),
    "usb_timeout": Known("board", "times",
        "so many reads of the board bring nothing; replug ends it",
        lambda board, order: board.time_out(order.times)),
    "protective_stop": Known("arm", "", "the arm stops by its own safety system",
        lambda arm, order: arm.controller.protective_stop()),
    "emergency_stop": Known("arm", "pressed",
        f"the arm brakes and loses power; {_AFTER}, from its next cycle on",
        lambda arm, order: arm.controller.emergency_stop(order.pressed)),
    "remote_control": Known("arm", "on",
        "on=false: the pendant is turned to Local, e-Series alone; the program ends, none is taken",
        lambda arm, order: arm.controller.set_remote_control(order.on)),
    "speed_slider": Known("arm", "fraction",
        "the arm's speed slider is turned: moves go on at that share of their pace",
        lambda arm, order: arm.controller.set_speed(order.fraction)),
    "arm_disconnect": Known("arm", "", "the connections that are open to the arm are closed",
        lambda arm, order: arm.drop_links()),
    "arm_freeze": Known("arm", "seconds",
        "the arm's controller does and answers nothing for so long",
        lambda arm, order: arm.freeze(order.seconds)),
}  # fmt: skip


def in_words(name: str) -> str:
    """A fault, its settings with their defaults and units, and what it does."""
    known, defaults = KNOWN[name], FaultOrder(name=name)
    told = (f"{each}={_shown(getattr(defaults, each))} ({UNITS[each]})" for each in known.settings)
    return f"{' '.join((name, *told))}: {known.does}"


def all_in_words() -> str:
    """Every fault, a line each."""
    later = f"each takes after_s=0 ({UNITS['after_s']}) too; what is given here are the defaults"
    return "\n".join((*map(in_words, KNOWN), later))


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


class CellFaults:
    """Faults of a cell; struck at once or at a later time."""

    def __init__(self, board: BoardModel, arm: UrEmulator, gripper: GripperEmulator | None) -> None:
        self._devices = {"board": board, "arm": arm, "gripper": gripper}
        self._arm = arm
        self._waiting: list[tuple[int, int, FaultOrder]] = []  # a heap: when, and which came first
        self._ordered = 0
        self._for_arm: deque[FaultOrder] = deque()
        self._of_arm = threading.Condition()
        self._asked = self._done = 0  # of the arm

    def order(self, request: dict[str, Any], now_ns: int) -> str:
        """Take a request; what it will do, in words. Raises ValueError for an unknown name, an
        argument out of place, and what this arm has not."""
        name = str(request.get("name", ""))
        names = [each for each in KNOWN if self._devices[KNOWN[each].device] is not None]
        if name not in names:
            raise ValueError(f"unknown fault {name!r:.60}: one of {', '.join(names)}")
        known = KNOWN[name]
        if strange := request.keys() - {*known.settings, "name", "after_s"}:
            raise ValueError(f"takes no {', '.join(sorted(strange)):.60}: {in_words(name)}")
        try:
            order = msgspec.convert(request, FaultOrder)
        except msgspec.ValidationError as error:
            raise ValueError(f"{error}: {in_words(name)}") from None
        if name == "remote_control":
            self._arm.controller.check_remote_control()
        if order.after_s:
            self._ordered += 1
            when_ns = now_ns + round(order.after_s * 1e9)
            heapq.heappush(self._waiting, (when_ns, self._ordered, order))
        else:
            self._hit(order)
        when = f" in {order.after_s:g} s" if order.after_s else ""
        told = (f"{each}={_shown(getattr(order, each))}" for each in known.settings)
        return f"{' '.join((name, *told))}{when}: {known.does}"

    def strike(self, now_ns: int) -> None:
        """Let happen what is due; the caller holds the cell's lock."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._hit(heapq.heappop(self._waiting)[2])

    def _hit(self, order: FaultOrder) -> None:
        known = KNOWN[order.name]
        if known.device == "arm":
            self._asked += 1
            self._for_arm.append(order)
        else:
            known.strike(self._devices[known.device], order)

    def strike_arm(self) -> None:
        """What is due at the arm, whose controller and connections belong to its own thread."""
        while self._for_arm:
            order = self._for_arm.popleft()
            KNOWN[order.name].strike(self._arm, order)
            with self._of_arm:
                self._done += 1
                self._of_arm.notify_all()

    def struck(self, seconds: float) -> bool:
        """Wait until all that was due at the arm by now has happened there; False where that takes
        longer. The caller must not hold the cell's lock, which the arm's thread needs."""
        asked = self._asked
        with self._of_arm:
            return self._of_arm.wait_for(lambda: self._done >= asked, seconds)
