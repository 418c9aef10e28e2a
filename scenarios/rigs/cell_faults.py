"""What can go wrong in the emulated cell, by name, at once or later."""

from collections import deque
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from drivers.robotiq.emulator.tcp import GripperEmulator, Trouble, WireFault
from drivers.takktile.model.board import BoardModel
from drivers.ur.emulator.robot import UrEmulator


class FaultOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One ``fault`` request: what goes wrong, when, and how much of it."""

    name: str
    after_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0  # from now on
    times: Annotated[int, Meta(ge=1)] = 1  # requests or reads that are hit
    skip: Annotated[int, Meta(ge=0)] = 0  # requests that are spared first
    seconds: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.1  # of a delay or a freeze
    code: Annotated[int, Meta(ge=1, le=15)] = 0x0E  # gripper fault; its default needs a reset
    pressed: bool = True  # emergency button


Strike = Callable[[FaultOrder], object]


class CellFaults:
    """Everything that can go wrong in a cell, by name; struck at once or at a later time."""

    def __init__(self, board: BoardModel, arm: UrEmulator, gripper: GripperEmulator | None) -> None:
        self._table: dict[str, tuple[set[str], Strike]] = {
            **({} if gripper is None else _gripper_faults(gripper)),
            "unplug": (set(), lambda order: board.unplug()),
            "replug": (set(), lambda order: board.replug()),
            "usb_timeout": ({"times"}, lambda order: board.time_out(order.times)),
        }
        self._arm_table: dict[str, tuple[set[str], Strike]] = {
            "protective_stop": (set(), lambda order: arm.controller.protective_stop()),
            "emergency_stop": (
                {"pressed"}, lambda order: arm.controller.emergency_stop(order.pressed)
            ),
            "arm_disconnect": (set(), lambda order: arm.drop_links()),
            "arm_freeze": ({"seconds"}, lambda order: arm.freeze(order.seconds)),
        }  # fmt: skip
        self._waiting: list[tuple[int, FaultOrder]] = []
        self._for_arm: deque[FaultOrder] = deque()

    def order(self, request: dict[str, Any], now_ns: int) -> None:
        """Take a request. Raises ValueError for an unknown name or an argument out of place."""
        order = msgspec.convert(request, FaultOrder)
        table = self._table | self._arm_table
        if order.name not in table:
            raise ValueError(f"unknown fault {order.name!r}: one of {', '.join(table)}")
        strange = request.keys() - table[order.name][0] - {"name", "after_s"}
        if strange:
            raise ValueError(f"fault {order.name!r} takes no {', '.join(sorted(strange))}")
        self._waiting.append((now_ns + round(order.after_s * 1e9), order))
        self.strike(now_ns)

    def strike(self, now_ns: int) -> None:
        """Let happen what is due; the caller holds the cell's lock."""
        due = [order for t_ns, order in self._waiting if t_ns <= now_ns]
        self._waiting = [waiting for waiting in self._waiting if waiting[0] > now_ns]
        for order in due:
            if order.name in self._arm_table:
                self._for_arm.append(order)
            else:
                self._table[order.name][1](order)

    def strike_arm(self) -> None:
        """What is due at the arm, whose controller and connections belong to its own thread."""
        while self._for_arm:
            order = self._for_arm.popleft()
            self._arm_table[order.name][1](order)


def _gripper_faults(gripper: GripperEmulator) -> dict[str, tuple[set[str], Strike]]:
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
        "gripper_drop": ({"times", "skip"}, plan(Trouble.DROP)),
        "gripper_delay": ({"times", "skip", "seconds"}, plan(Trouble.DELAY)),
        "gripper_garble": ({"times", "skip"}, plan(Trouble.GARBLE)),
        "gripper_freeze": ({"seconds", "skip"}, plan(Trouble.FREEZE)),
        "gripper_disconnect": ({"times"}, disconnect),
        "gripper_fault": ({"code"}, lambda order: gripper.hand.model.inject_fault(order.code)),
    }
