"""The table of states, and its diagram in the documentation."""

from pathlib import Path

import pytest
from transitions import MachineError
from transitions.extensions.diagrams import HierarchicalGraphMachine
from transitions.extensions.nesting import NestedState

from grasp.control.states import TRANSITIONS, State, StateMachine, Trigger

PAGE = Path(__file__).parents[3] / "docs" / "architecture.md"


class DottedState(NestedState):
    separator = "."


class Diagram(HierarchicalGraphMachine):
    state_cls = DottedState


def diagram() -> str:
    """The table as a Mermaid diagram of `transitions`, in two levels."""
    top: dict[str, list[str]] = {}
    for state in State:
        parent, _, child = state.value.partition(".")
        top.setdefault(parent, []).extend([child] if child else [])
    machine = Diagram(
        states=[{"name": n, "children": inner} if inner else n for n, inner in top.items()],
        transitions=[[str(t), [*map(str, sources)], str(to)] for t, sources, to in TRANSITIONS],
        initial=State.START.value, auto_transitions=False, graph_engine="mermaid",
        title="title: States of a grasp",
    )  # fmt: skip
    lines: list[str] = machine.get_graph().source.splitlines()
    return "\n".join(line.rstrip() for line in lines)


def test_exactly_the_transitions_of_the_table_are_possible() -> None:
    for trigger in Trigger:
        for state in State:
            machine = StateMachine(state)
            within = {state.value, state.partition(".")[0]}
            expected = [
                dest for t, sources, dest in TRANSITIONS if t is trigger if within & {*sources}
            ]
            if expected:
                machine.fire(trigger, 0, "test")
                assert [machine.state] == expected
            else:
                with pytest.raises(MachineError):
                    machine.fire(trigger, 0, "test")


def test_a_transition_is_logged_with_its_time_and_cause() -> None:
    machine = StateMachine(State.FEEL)
    machine.fire(Trigger.FEEL, 3, "tighter")
    machine.fire(Trigger.LOSE, 5, "gone")
    assert [(c.phase, c.t_ns, c.cause) for c in machine.log] == [
        ("lower.feel", 3, "tighter"), ("lost", 5, "gone"),
    ]  # fmt: skip
    assert machine.before is State.FEEL
    assert machine.first_ns(State.LOST) == 5


def test_diagram_in_the_documentation_matches_the_table() -> None:
    diagram_states = f"```mermaid\n{diagram()}\n```"
    assert diagram_states in PAGE.read_text(), f"put this into {PAGE.name}:\n{diagram_states}"
