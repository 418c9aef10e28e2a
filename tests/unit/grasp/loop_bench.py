"""Fake devices, step and clock of a control loop, which record its calls."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

from grasp.control.commands import Command, HoldFingers, StopArm
from grasp.control.controller_settings import LoopSettings
from grasp.control.safe_state import Unconfirmed
from grasp.control.states import State
from grasp.run.clock import VirtualClock
from grasp.run.loop import ControlLoop, Devices, Tick
from tests.unit.grasp.builders import arm, frame, gripper, observation

MS = 1_000_000
LIMITS = {"stop_s", "abort_s", "observer_reserve_s"}


class Bench:
    """A control loop with fake parts, and the calls that it made."""

    def __init__(self, *, wall: bool = False, **settings: float) -> None:
        self.clock: Any = VirtualClock(lambda t_ns: None, 10**9)
        self.clock.virtual = not wall
        self.calls: list[tuple[Any, ...]] = []  # to the devices, with the time
        self.raises: dict[str, BaseException] = {}
        self.inputs: list[Any] = []
        self.decides: list[tuple[Command, ...]] = []  # a step each
        self.ticks: list[Tick] = []
        self.acknowledged = True
        self.fallback: Any = HoldFingers()
        self.fallbacks: list[Any] = []  # a step each: the command, and its words
        self.gripper_state: Any = gripper()
        self.controller = SimpleNamespace(
            finished=False, arm_delay_ns=0.0, in_safe_state=False, state=State.LIFT, faults=(),
            abort_commands=lambda: (StopArm(2.0), HoldFingers()),
            unconfirmed_parts=lambda obs: Unconfirmed(
                ("moves",) if obs.arm.moving else (), () if obs.hand_rests else ("moves",)
            ),
        )  # fmt: skip
        self.step: Any = SimpleNamespace(
            controller=self.controller,
            decide=self._decide,
            last_close=None,
            admit=lambda command, state: command,
            fallback=lambda commands, state: self.fallback,
            hidden=Counter[str](),
        )
        self.frame: Any = frame()
        hand = SimpleNamespace(
            state=self.gripper_state, acknowledged=True, poll=self._of("gripper poll"),
            move_to=self._of("move_to"), close_to_limit=self._of("close_to_limit"),
            open=self._of("open"), hold=self._of("hold"),
            set_fallback=lambda command, words: self.fallbacks.append((command, words)),
        )  # fmt: skip
        body = SimpleNamespace(
            state=arm(), poll=self._of("arm poll"), move_to=self._of("arm"), stop=self._of("stop")
        )
        board = SimpleNamespace(
            frame=self.frame, rest_taken=True, poll=self._of("board poll"),
            begin_rest=self._of("rest"),
        )  # fmt: skip
        self.hand, self.arm, self.board = hand, body, board
        devices: Any = Devices(hand, body, board)  # type: ignore[arg-type]
        limits = {name: settings.pop(name) for name in LIMITS & settings.keys()}
        asked = LoopSettings(**{"decision_delay_s": 0.002} | settings)
        self.loop = ControlLoop(devices, self.clock, self.step, asked, self.ticks.append)
        for name, value in limits.items():
            setattr(self.loop, name, value)

    def _of(self, name: str) -> Any:
        def act(*asked: Any) -> Any:
            if name in self.raises:
                raise self.raises[name]
            self.calls.append((name, self.clock.now_ns, *asked))
            return f"applied {name}"

        return act

    def _decide(self, inputs: Any) -> Any:
        self.inputs.append(inputs)
        commands = self.decides.pop(0) if self.decides else ()
        observed = observation(inputs.t_ns, gripper=inputs.gripper, arm=inputs.arm)
        return SimpleNamespace(
            observation=observed,
            decision=SimpleNamespace(
                commands=commands, finished=self.controller.finished, state=self.controller.state
            ),
            admitted=commands,
        )

    def verbs(self) -> list[tuple[Any, ...]]:
        return [(name, *asked) for name, _, *asked in self.calls if "poll" not in name]

    def when(self, name: str) -> list[int]:
        return [at for called, at, *_ in self.calls if called == name]
