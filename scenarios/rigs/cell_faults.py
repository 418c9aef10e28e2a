"""Faults that can be injected into the emulated cell by name, at once or later."""

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
    """One ``fault`` request: name, delay and settings of the fault."""

    name: str
    after_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0  # from now
    times: Annotated[int, Meta(ge=1)] = 1
    skip: Annotated[int, Meta(ge=0)] = 0
    seconds: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.1  # duration of a delay or freeze
    code: Annotated[int, Meta(ge=0, le=15)] = 0x0E  # gripper fault; the default needs a reset
    pressed: bool = True  # emergency button
    on: bool = True  # remote control
    fraction: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.2  # of the speed slider


UNITS = {
    "after_s": "s from now, to 600", "times": "requests or reads hit",
    "skip": "requests before the first one hit", "seconds": "s, to 60", "code": "0 to 15",
    "pressed": "true or false", "on": "true or false", "fraction": "0 to 1",
}  # fmt: skip


class CellFault(NamedTuple):
    """One kind of fault: the device (board, arm or gripper), its settings, its effect as text, and
    the function that applies it."""

    device: str
    settings: str
    effect: str
    apply: Callable[[Any, FaultOrder], object]


def _on_wire(kind: FaultKind) -> Callable[[GripperEmulator, FaultOrder], object]:
    return lambda gripper, order: gripper.faults.add(
        WireFault(kind=kind, times=order.times, skip=order.skip, seconds=order.seconds)
    )


def _disconnect(gripper: GripperEmulator, order: FaultOrder) -> None:
    gripper.disconnect()
    if order.times > 1:
        gripper.faults.add(WireFault(kind=FaultKind.DISCONNECT, times=order.times - 1))


_AFTER = "pressed=false releases the button; the dashboard then accepts power on and brake release"
CELL_FAULTS = {
    "gripper_drop": CellFault("gripper", "times skip", "requests get no reply",
        _on_wire(FaultKind.DROP)),
    "gripper_delay": CellFault("gripper", "times skip seconds", "replies are delayed",
        _on_wire(FaultKind.DELAY)),
    "gripper_garble": CellFault("gripper", "times skip", "replies are damaged",
        _on_wire(FaultKind.GARBLE)),
    "gripper_freeze": CellFault("gripper", "seconds skip",
        "no replies for this time, starting at a request", _on_wire(FaultKind.FREEZE)),
    "gripper_disconnect": CellFault("gripper", "times",
        "the connection is closed; times above 1: new connections too", _disconnect),
    "gripper_fault": CellFault("gripper", "code",
        "this gFLT is reported; code=0 clears it, except 13 to 15, which need an activation",
        lambda gripper, order: gripper.model.inject_fault(order.code)),
    "unplug": CellFault("board", "", "the fingertips' board is off the USB bus, until replug",
        lambda board, order: board.unplug()),
    "replug": CellFault("board", "", "the board is plugged in again, stopped and without faults",
        lambda board, order: board.replug()),
    "usb_timeout": CellFault("board", "times",
        "reads of the board time out; replug ends it",
        lambda board, order: board.time_out(order.times)),
    "protective_stop": CellFault("arm", "", "the arm is stopped by its safety system",
        lambda arm, order: arm.controller.protective_stop()),
    "emergency_stop": CellFault("arm", "pressed",
        f"the arm brakes and loses power; {_AFTER}, from its next cycle on",
        lambda arm, order: arm.controller.emergency_stop(order.pressed)),
    "remote_control": CellFault("arm", "on",
        "on=false: the pendant is set to Local (e-Series only); the program ends, none is accepted",
        lambda arm, order: arm.controller.set_remote_control(order.on)),
    "speed_slider": CellFault("arm", "fraction",
        "the arm's speed slider is set: motions continue at that share of their speed",
        lambda arm, order: arm.controller.set_speed_slider(order.fraction)),
    "arm_disconnect": CellFault("arm", "", "open connections to the arm are closed",
        lambda arm, order: arm.drop_links()),
    "arm_freeze": CellFault("arm", "seconds",
        "the arm's controller neither moves nor replies for this time",
        lambda arm, order: arm.freeze(order.seconds)),
}  # fmt: skip


def describe_fault(order: FaultOrder, units: bool = True) -> str:
    """A fault's name, settings, delay and effect, as one line."""
    words = [order.name]
    for setting in CELL_FAULTS[order.name].settings.split():
        value = getattr(order, setting)
        text = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        words.append(f"{setting}={text}" + (f" ({UNITS[setting]})" if units else ""))
    delay = f" in {order.after_s:g} s" if order.after_s else ""
    return f"{' '.join(words)}{delay}: {CELL_FAULTS[order.name].effect}"


def describe_all_faults() -> str:
    """One line per fault with default values and units."""
    note = f"each also takes after_s=0 ({UNITS['after_s']}); the values shown are the defaults"
    return "\n".join((*(describe_fault(FaultOrder(name=name)) for name in CELL_FAULTS), note))


class CellFaults:
    """Faults of a cell, applied at once or after a delay."""

    def __init__(self, board: BoardModel, arm: UrEmulator, gripper: GripperEmulator | None) -> None:
        self._devices = {"board": board, "arm": arm, "gripper": gripper}
        self._arm = arm
        self._pending: list[tuple[int, FaultOrder]] = []  # a heap, by time
        self._arm_queue: Queue[FaultOrder] = Queue()  # due faults for the arm's thread

    def order(self, request: dict[str, Any], now_ns: int) -> str:
        """Accept a request; returns its effect as text. Raises ValueError for an unknown name, a
        wrong argument, and a feature that this arm lacks."""
        name = str(request.get("name", ""))
        names = [n for n, kind in CELL_FAULTS.items() if self._devices[kind.device] is not None]
        if name not in names:
            raise ValueError(f"unknown fault {name!r:.60}: one of {', '.join(names)}")
        usage = describe_fault(FaultOrder(name=name))
        if unknown := request.keys() - {*CELL_FAULTS[name].settings.split(), "name", "after_s"}:
            raise ValueError(f"takes no {', '.join(sorted(unknown)):.60}: {usage}")
        try:
            order = msgspec.convert(request, FaultOrder)
        except msgspec.ValidationError as error:
            raise ValueError(f"{error}: {usage}") from None
        if name == "remote_control":
            self._arm.controller.check_remote_control()
        heapq.heappush(self._pending, (now_ns + round(order.after_s * 1e9), order))
        self.apply_due(now_ns)
        return describe_fault(order, units=False)

    def apply_due(self, now_ns: int) -> None:
        """Apply all due faults; the caller holds the cell's lock."""
        while self._pending and self._pending[0][0] <= now_ns:
            order = heapq.heappop(self._pending)[1]
            kind = CELL_FAULTS[order.name]
            if kind.device == "arm":
                self._arm_queue.put(order)
            else:
                kind.apply(self._devices[kind.device], order)

    def apply_due_to_arm(self) -> None:
        """Apply the arm's due faults; call it in the arm's thread."""
        while not self._arm_queue.empty():
            order = self._arm_queue.get()
            CELL_FAULTS[order.name].apply(self._arm, order)
            self._arm_queue.task_done()

    def wait_applied_to_arm(self, seconds: float) -> bool:
        """Wait until the arm's due faults are applied; False after that many seconds. The caller
        must not hold the cell's lock, which the arm's thread needs."""
        with self._arm_queue.all_tasks_done:
            return self._arm_queue.all_tasks_done.wait_for(
                lambda: not self._arm_queue.unfinished_tasks, seconds
            )
