"""Faults that can be ordered in the emulated cell by name, at once or later."""

import heapq
from collections.abc import Callable
from queue import Queue
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta

from drivers.robotiq.emulator import FaultKind, GripperEmulator, WireFault
from drivers.takktile.model.board import BoardModel
from drivers.ur.emulator.server import UrEmulator


class FaultOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, order=True):
    """One ``fault`` request: what goes wrong, when, and how much of it."""

    name: str
    after_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0  # from now on
    times: Annotated[int, Meta(ge=1)] = 1
    skip: Annotated[int, Meta(ge=0)] = 0
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


def _on_wire(kind: FaultKind) -> Callable[[GripperEmulator, FaultOrder], object]:
    return lambda gripper, order: gripper.faults.add(
        WireFault(kind=kind, times=order.times, skip=order.skip, seconds=order.seconds)
    )


def _disconnect(gripper: GripperEmulator, order: FaultOrder) -> None:
    gripper.disconnect()
    if order.times > 1:
        gripper.faults.add(WireFault(kind=FaultKind.DISCONNECT, times=order.times - 1))


_AFTER = "pressed=false releases the button, and its dashboard takes power on and brake release"
KNOWN = {
    "gripper_drop": Known("gripper", "times skip", "requests get no reply",
        _on_wire(FaultKind.DROP)),
    "gripper_delay": Known("gripper", "times skip seconds", "replies come later by so long",
        _on_wire(FaultKind.DELAY)),
    "gripper_garble": Known("gripper", "times skip", "replies are damaged",
        _on_wire(FaultKind.GARBLE)),
    "gripper_freeze": Known("gripper", "seconds skip",
        "nothing is answered for so long, from a request on", _on_wire(FaultKind.FREEZE)),
    "gripper_disconnect": Known("gripper", "times",
        "the connection is cut; with more, new connections too", _disconnect),
    "gripper_fault": Known("gripper", "code",
        "this gFLT is reported; code=0 takes it back, but 13 to 15, which an activation ends",
        lambda gripper, order: gripper.model.inject_fault(order.code)),
    "unplug": Known("board", "", "the fingertips' board is off the USB bus, until replug",
        lambda board, order: board.unplug()),
    "replug": Known("board", "", "the board is plugged in again, stopped and without faults",
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
        lambda arm, order: arm.controller.set_speed_slider(order.fraction)),
    "arm_disconnect": Known("arm", "", "the connections that are open to the arm are closed",
        lambda arm, order: arm.drop_links()),
    "arm_freeze": Known("arm", "seconds",
        "the arm's controller does and answers nothing for so long",
        lambda arm, order: arm.freeze(order.seconds)),
}  # fmt: skip


def in_words(order: FaultOrder, units: bool = True) -> str:
    """A fault with its settings, when it happens, and what it does."""
    words = [order.name]
    for setting in KNOWN[order.name].takes.split():
        value = getattr(order, setting)
        shown = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        words.append(f"{setting}={shown}" + (f" ({UNITS[setting]})" if units else ""))
    later = f" in {order.after_s:g} s" if order.after_s else ""
    return f"{' '.join(words)}{later}: {KNOWN[order.name].does}"


def all_in_words() -> str:
    """Every fault, a line each, with defaults and units."""
    later = f"each takes after_s=0 ({UNITS['after_s']}) too; what is given here are the defaults"
    return "\n".join((*(in_words(FaultOrder(name=name)) for name in KNOWN), later))


class CellFaults:
    """Faults of a cell; struck at once or at a later time."""

    def __init__(self, board: BoardModel, arm: UrEmulator, gripper: GripperEmulator | None) -> None:
        self._devices = {"board": board, "arm": arm, "gripper": gripper}
        self._arm = arm
        self._waiting: list[tuple[int, FaultOrder]] = []  # a heap, by time
        self._of_arm: Queue[FaultOrder] = Queue()  # due, for the arm's own thread

    def order(self, request: dict[str, Any], now_ns: int) -> str:
        """Take a request; what it will do, in words. Raises ValueError for an unknown name, an
        argument out of place, and what this arm does not have."""
        name = str(request.get("name", ""))
        names = [each for each in KNOWN if self._devices[KNOWN[each].device] is not None]
        if name not in names:
            raise ValueError(f"unknown fault {name!r:.60}: one of {', '.join(names)}")
        usage = in_words(FaultOrder(name=name))
        if strange := request.keys() - {*KNOWN[name].takes.split(), "name", "after_s"}:
            raise ValueError(f"takes no {', '.join(sorted(strange)):.60}: {usage}")
        try:
            order = msgspec.convert(request, FaultOrder)
        except msgspec.ValidationError as error:
            raise ValueError(f"{error}: {usage}") from None
        if name == "remote_control":
            self._arm.controller.check_remote_control()
        heapq.heappush(self._waiting, (now_ns + round(order.after_s * 1e9), order))
        self.strike(now_ns)
        return in_words(order, units=False)

    def strike(self, now_ns: int) -> None:
        """Let happen what is due; the caller holds the cell's lock."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            order = heapq.heappop(self._waiting)[1]
            known = KNOWN[order.name]
            if known.device == "arm":
                self._of_arm.put(order)
            else:
                known.strike(self._devices[known.device], order)

    def strike_arm(self) -> None:
        """What is due at the arm, whose controller and connections belong to its own thread."""
        while not self._of_arm.empty():
            order = self._of_arm.get()
            KNOWN[order.name].strike(self._arm, order)
            self._of_arm.task_done()

    def struck(self, seconds: float) -> bool:
        """Wait until all that was due at the arm by now has happened there; False where that takes
        longer. The caller must not hold the cell's lock, which the arm's thread needs."""
        with self._of_arm.all_tasks_done:
            return self._of_arm.all_tasks_done.wait_for(
                lambda: not self._of_arm.unfinished_tasks, seconds
            )
