"""The picture of a step's data in docs/architecture.md has the arrows that a step's data take.

A step is taken whose parts note what they are handed; every value is one of a kind, so that it is
known from whom it comes.
"""

import ast
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from grasp.commands import CloseFast
from grasp.controller import Decision, GraspController
from grasp.doubt import Doubts
from grasp.guard import ForceGuard
from grasp.observation import Observation, StepInput
from grasp.step import GraspStep
from tests.unit.test_architecture import PAGE, labelled

ROOT = Path(__file__).parents[2]
Flow = tuple[str, str, str]  # from whom, which field, to whom
PARTS = ("detector", "doubts", "guard", "controller")
OWN = {"measured_n", "felt_n", "overloaded"}  # what the guard makes of the frame


class Traced(GraspStep):
    """A step whose parts tell where each thing that they are handed comes from."""

    def __init__(self, failing: bool = False, **flags: bool) -> None:
        self.flows: set[Flow] = set()
        self.origin: dict[int, tuple[str, str]] = {}
        self.kept: list[object] = []  # or an id would be given again
        self.failing = failing
        asked, self.let = (CloseFast(n, (True,) * 3, (1, 2, 3), 0.1) for n in (8.0, 9.0))
        self.of("Decision", "commands", asked)
        self.of("guard", "last_close", self.let)
        flags = {"reset_detector": False, "anchor": False, **flags}
        phase = self.of("controller", "phase", object())
        decision = Decision(cast(Any, phase), cast(Any, object()), (asked,), **flags)
        guard = SimpleNamespace(
            measured_n=lambda sums: self.hears("guard", *sums) or (1.0, 2.0, len(self.kept)),
            overloaded=lambda forces: self.of("guard", "overloaded", object()),
            reach=lambda state, forces: (
                self.hears("guard", state) or self.of("guard", "reach_counts", object())
            ),
            thumb_end=self.of("guard", "thumb_end", object()),
            anchor=lambda where, forces: self.hears("guard", where, ("Decision", "anchor")),
            admit=lambda command, state, forces: self.hears("guard", command, state) or self.let,
        )
        doubts = SimpleNamespace(
            of=lambda *told: self.hears("doubts", *told) or self.of("doubts", "doubt", "odd"),
            sent=lambda out, arm: self.hears("doubts", arm, *(("guard", "admitted") for _ in out)),
            believes_force=True,
            can_tell=1,
            all_tell=False,
        )
        detector = SimpleNamespace(
            update=self._listen_to,
            reset=lambda: self.hears("detector", ("Decision", "reset_detector")),
        )
        controller = SimpleNamespace(phase=phase, step=lambda seen: decision)
        if failing:
            doubts.of = lambda *told: ""
        super().__init__(
            detector, cast(GraspController, controller), cast(ForceGuard, guard),
            cast(Doubts, doubts), lambda: self.of("detector", "motion", cast(Any, object())),
        )  # fmt: skip

    def of(self, part: str, field: str, value: Any) -> Any:
        self.origin[id(value)] = part, field
        self.kept.append(value)
        return value

    def hears(self, part: str, *values: object) -> None:
        for value in values:
            known = value if isinstance(value, tuple) else self.origin.get(id(value))
            if known is not None:
                self.flows.add((str(known[0]), str(known[1]), part))

    def _listen_to(self, counts: Any) -> Any:
        self.hears("detector", counts)
        if self.failing:
            raise ZeroDivisionError
        return self.of("detector", "probabilities", np.ones(3))

    def told(self) -> StepInput:
        """One of a kind each."""
        sums = [self.of("StepInput", "frame", object()) for _ in range(3)]
        counts = Counts(sums)
        positions = self.of("StepInput", "gripper", object())
        values = {name: object() for name in StepInput.__struct_fields__}
        values["frame"] = SimpleNamespace(counts=counts, stale=False)
        values["gripper"] = SimpleNamespace(at_least_counts=positions)
        for name, value in values.items():
            self.of("StepInput", name, value)
        self.of("StepInput", "frame", counts)
        return StepInput(**cast(dict[str, Any], values))


class Counts:
    """Of a frame, whose sums are one of a kind."""

    def __init__(self, sums: list[object]) -> None:
        self.sums = sums

    def __mul__(self, mask: object) -> "Counts":
        return self

    def sum(self, axis: int) -> Any:
        return SimpleNamespace(tolist=lambda: self.sums)


def taken(**flags: bool) -> set[Flow]:
    """Where the data of two steps went."""
    step = Traced(**flags)
    step.decide(step.told())
    step.flows.clear()
    result = step.decide(step.told())
    for name in Observation.__struct_fields__:
        value = getattr(result.observation, name)
        if name == "doubt" and step.failing:
            assert value.startswith("detector_failed")
            step.flows.add(("detector", "doubt", "Observation"))
        elif id(value) in step.origin or name in OWN:
            tail, field = step.origin.get(id(value), ("guard", name))
            step.flows.add((tail, field, "Observation"))
    assert result.admitted == (step.let,)
    return step.flows


@pytest.fixture(scope="module")
def drawn() -> set[Flow]:
    """Arrows with fields into the parts of a step, and into what the controller is told."""
    picture = PAGE.read_text("utf-8").split("```mermaid\nflowchart TD\n")[1].split("```")[0]
    heads = (*PARTS, "Observation")
    arrows = [(tail, fields, head) for tail, fields, head in labelled(picture) if head in heads]
    return {(tail, field, head) for tail, fields, head in arrows for field in fields}


def test_the_data_of_a_step_take_the_arrows_that_are_drawn(drawn: set[Flow]) -> None:
    always = taken()
    assert taken(reset_detector=True) - always == {("Decision", "reset_detector", "detector")}
    assert taken(anchor=True) - always == {("Decision", "anchor", "guard")}
    flags = {flow for name in ("reset_detector", "anchor") for flow in taken(**{name: True})}
    assert always | flags | taken(failing=True) == drawn


# the parts of the picture that are modules, and what moves a device
DEVICES = {"Gripper", "Arm", "TactileSensor", "Devices"}
MODULES = {"controller": "controller", "guard": "guard", "doubts": "doubt", "loop": "loop"}


def test_only_who_is_drawn_with_an_arrow_to_the_devices_knows_their_verbs() -> None:
    picture = PAGE.read_text("utf-8").split("```mermaid\nflowchart TD\n")[1].split("```")[0]
    arrows = {tail for tail, _, head in labelled(picture) if head == "devices"}
    assert arrows == {part for part, module in MODULES.items() if _moves_devices(module)}


def _moves_devices(module: str) -> bool:
    tree = ast.parse((ROOT / "grasp" / f"{module}.py").read_text("utf-8"))
    return any(isinstance(n, ast.Name) and n.id in DEVICES for n in ast.walk(tree))
