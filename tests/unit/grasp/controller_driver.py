"""Driver of a controller with a hand and an arm that execute commands at once."""

import msgspec

from detector.decision import DecisionRule, RuleSettings
from drivers.interfaces import Counts3, Detection, GripperState, Vector3
from grasp.control.commands import (
    CloseToLimit,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller import GraspController
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.slip_monitor import SlipMonitor, SlipSettings
from grasp.control.states import State
from grasp.control.transition import Decision
from tests.unit.grasp.builders import arm, gripper, observation

TICK = 10_000_000
HEIGHT = 0.2
MOVING = (Detection.MOVING, Detection.AT_TARGET, Detection.AT_TARGET)
RESTING = (Detection.AT_TARGET, Detection.AT_TARGET, Detection.AT_TARGET)
LATCHED = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)


STIFF = Stiffness(1.9)  # as of a rigid object: a step is one count


class Driver:
    """Steps a controller in ticks of 10 ms. The hand executes commands at once: a moved finger
    reaches its position, a closing thumb stops on the object."""

    grip = 55  # counts of every finger in the first grasp
    climbs_m = 0.05  # where the arm is while it climbs

    def __init__(
        self, home: Vector3 | None = None, stiffness: Stiffness = STIFF, **settings: object
    ) -> None:
        merged = msgspec.structs.replace(ControllerSettings(), **settings)
        monitor = SlipMonitor(DecisionRule(RuleSettings(), 3), SlipSettings())
        plan = GripPlan((25, 40, 40), (self.grip,) * 3, 10.0, stiffness, home)
        self.controller = GraspController(merged, plan, monitor)
        self.t_ns = 0
        self.height_m = 0.0
        self.closed = False
        self.stopped = False  # the last command to the arm was a stop
        self.last_close: CloseToLimit | None = None
        self.reach: Counts3 | None = None
        self.end: int | None = None  # of the thumb
        self.requested: Counts3 = (0, 0, 0)
        self.commands: list[object] = []

    def hand(self, **changes: object) -> GripperState:
        """The hand's status in the next step."""
        a, b, c = self.requested
        values: dict[str, object] = {"positions": (a, b, c)}
        if self.closed:
            values = {"positions": (60, b, c), "requested": (255, b, c), "detections": LATCHED}
        return gripper(self.t_ns + TICK, **{**values, **changes})  # type: ignore[arg-type]

    def obey(self, command: object) -> None:
        if isinstance(command, MoveFingers):
            self.requested, self.closed = command.targets_counts, False
        elif isinstance(command, CloseToLimit) and command.first_stage:
            _, b, c = self.requested
            self.requested = (command.ends_counts[0], b, c)
            self.last_close = msgspec.structs.replace(command, closing=(True, False, False))
        elif isinstance(command, CloseToLimit):
            self.closed = True
            self.last_close = CloseToLimit(10.0, (True, False, False), (255, 255, 255), 0.06)
        elif isinstance(command, OpenFingers):
            self.requested, self.closed = (6, 6, 6), False
        elif isinstance(command, MoveArm | StopArm):
            self.stopped = isinstance(command, StopArm)

    def rest(self) -> None:
        """Step until no earlier command can still start the hand."""
        for _ in range(11):
            self.step()

    def step(self, p: float = 0.0, **changes: object) -> Decision:
        changes.setdefault("gripper", self.hand())
        self.t_ns += TICK
        changes.setdefault("arm", arm(self.t_ns, self.height_m))
        changes.setdefault("last_close", self.last_close)
        changes.setdefault("safe_travel_counts", self.reach)
        changes.setdefault("thumb_end_counts", self.end)
        if self.controller.state is State.BRACE:  # the thumb still waits
            _, b_n, c_n = changes.get("estimated_n", (2.0, 1.0, 1.0))  # type: ignore[misc]
            changes["estimated_n"] = (0.0, b_n, c_n)
        decision = self.controller.step(observation(self.t_ns, p, **changes))
        self.commands += decision.commands
        for command in decision.commands:
            self.obey(command)
        return decision

    def until(self, phase: State, p: float = 0.0, **changes: object) -> Decision:
        for _ in range(400):
            decision = self.step(p, **changes)
            if decision.state is phase:
                return decision
        raise AssertionError(f"never reached {phase}, stuck in {self.controller.state}")

    def until_next(self, **changes: object) -> None:
        """Step until the next transition, also one to the same state."""
        log = self.controller.machine.log
        entered = len(log)
        while len(log) == entered:
            self.step(**changes)  # type: ignore[arg-type]

    def lift(self) -> "Driver":
        self.until(State.LIFT)
        self.commands.clear()
        return self

    def climb(self, p: float = 0.0, **changes: object) -> Decision:
        """Make one step with the arm rising, or stopped by the slip response."""
        stopped = self.stopped and self.controller.state is State.COMPENSATE
        there = arm(self.t_ns + TICK, self.climbs_m, moving=not stopped)
        return self.step(p, arm=there, **changes)

    def slip(self) -> "Driver":
        self.lift()
        for _ in range(2):
            self.climb(0.9)
        assert self.controller.state is State.COMPENSATE
        return self
