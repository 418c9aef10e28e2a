"""A replay reports edits of a recording, wherever the control step shows them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import BadFile
from grasp.control.commands import CloseToLimit, OpenFingers
from grasp.run.messages import ARM, COMMANDS, CONTROL, GRIPPER, PHASES, TACTILE
from grasp.run.recording import RunRecorder, RunRecording
from scenarios.lift.lift import lift
from scenarios.report.run_record import read_run
from scenarios.trial.replay import replay_run
from scenarios.trial.run_folder import RUN_CHANNELS
from tests.unit.scenarios.conftest import config

replace = msgspec.structs.replace
Messages = list[tuple[str, int, Any]]
DELAY_NS = 50_000_000


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RunRecording:
    """A lift with delayed commands."""
    delayed = config("loop.decision_delay_s=0.05", "controller.lift_height_m=0.03")
    result = lift.run(delayed, 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None and result.recording is not None
    return RunRecording(Path(result.recording), RUN_CHANNELS)


def written(out: Path, messages: Messages, metadata: dict[str, str]) -> Path:
    with RunRecorder(out, RUN_CHANNELS, metadata) as writer:
        for message in messages:
            writer.write(*message)
    assert writer.failure is None
    return out


def the(topic: str, messages: Messages, number: int) -> int:
    """Index of the n-th message of a channel."""
    return [i for i, (name, *_) in enumerate(messages) if name == topic][number]


def closing(messages: Messages) -> int:
    """Index of the first closing, the response to slip."""
    return next(
        i for i, (name, _, m) in enumerate(messages)
        if name == COMMANDS and isinstance(m.admitted, CloseToLimit)
    )  # fmt: skip


def changed(messages: Messages, at: int, **values: Any) -> None:
    name, t_ns, message = messages[at]
    messages[at] = name, t_ns, replace(message, **values)


def command_lost(messages: Messages) -> None:
    del messages[closing(messages)]


def command_added(messages: Messages) -> None:
    name, t_ns, message = messages[closing(messages)]
    opened = replace(message, requested=OpenFingers(0.05), admitted=OpenFingers(0.05))
    messages.insert(closing(messages), (name, t_ns, opened))


def command_weaker(messages: Messages) -> None:
    at = closing(messages)
    asked, admitted = messages[at][2].requested, messages[at][2].admitted
    weak = {"force_limit_n": 5.0}
    changed(messages, at, requested=replace(asked, **weak), admitted=replace(admitted, **weak))


def command_too_early(messages: Messages) -> None:
    at = closing(messages)
    name, t_ns, message = messages.pop(at)
    messages.insert(at, (name, t_ns - DELAY_NS, message))


def state_lost(topic: str) -> Callable[[Messages], None]:
    def edit(messages: Messages) -> None:
        del messages[the(topic, messages, 400)]

    return edit


def phase_lost(messages: Messages) -> None:
    del messages[the(PHASES, messages, 3)]


def phase_renamed(messages: Messages) -> None:
    changed(messages, the(PHASES, messages, 3), phase="hold")


def other_probability(messages: Messages) -> None:
    changed(messages, the(CONTROL, messages, 300), probabilities=[0.5, 0.5, 0.5])


def other_bytes(act: int, edit: Callable[[list[int]], None]) -> Callable[[Messages], None]:
    """Edit the bytes in the first state after the write of the closing, or of the ``act``-th later
    write."""

    def change(messages: Messages) -> None:
        wrote = closing(messages)
        states = [
            (i, m) for i, (name, t_ns, m) in enumerate(messages)
            if name == GRIPPER and m.written_ns >= messages[wrote][1]
        ]  # fmt: skip
        writes = sorted({m.written_ns for _, m in states})
        at, state = next((i, m) for i, m in states if m.written_ns == writes[act])
        data = list(bytes.fromhex(state.written))
        edit(data)
        changed(messages, at, written=bytes(data).hex())

    return change


def b_closes_too(data: list[int]) -> None:
    data[-10] = 255


def stronger(data: list[int]) -> None:
    data[-11] += 1


def write_missing(messages: Messages) -> None:
    """The closing was not written, although the status follows it."""
    at = closing(messages)
    before = next(m for name, _, m in reversed(messages[:at]) if name == GRIPPER)
    for i, (name, *_) in enumerate(messages):
        if i > at and name == GRIPPER:
            changed(messages, i, written=before.written, written_ns=before.written_ns)


EDITS: dict[str, Callable[[Messages], None]] = {
    "a command is lost": command_lost,
    "a command that no step decided": command_added,
    "a command is another, asked and admitted": command_weaker,
    "a command is sent before its delay has passed": command_too_early,
    "another finger was commanded to close": other_bytes(0, b_closes_too),
    "more force was written": other_bytes(0, stronger),
    "fingers were not opened as commanded": other_bytes(-1, b_closes_too),
    "a command was never written": write_missing,
    "a state of the gripper is lost": state_lost(GRIPPER),
    "a state of the arm is lost": state_lost(ARM),
    "a change of phase is lost": phase_lost,
    "a change of phase leads elsewhere": phase_renamed,
    "the detector's output is another": other_probability,
}


@pytest.mark.parametrize("part", range(3))
def test_an_edit_is_a_difference(part: int, recorded: RunRecording, tmp_path: Path) -> None:
    for what in list(EDITS)[part::3]:
        messages = list(recorded)
        EDITS[what](messages)
        assert replay_run(written(tmp_path / "b.mcap", messages, recorded.metadata)).differences, (
            what
        )


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        (CONTROL, ["probabilities"]),
        (TACTILE, ["counts"]),
        (TACTILE, ["counts", "raw", "temperature"] * 3),
    ],
)
def test_a_report_of_messages_of_another_length_is_refused(
    topic: str, fields: list[str], recorded: RunRecording, tmp_path: Path
) -> None:
    messages = list(recorded)
    at = the(topic, messages, 1)
    for name in fields:  # a frozen message would not accept them
        list.append(getattr(messages[at][2], name), 1)
    path = written(tmp_path / "other.mcap", messages, recorded.metadata)
    with pytest.raises(BadFile, match=f"message on {topic} "):
        read_run(path)


def test_replay_of_an_incomplete_recording_reports_its_early_end(
    recorded: RunRecording, tmp_path: Path
) -> None:
    messages = list(recorded)
    whole = replay_run(written(tmp_path / "a.mcap", messages, recorded.metadata))
    assert not whole.differences
    half = written(tmp_path / "b.mcap", messages[: the(CONTROL, messages, 500)], recorded.metadata)
    assert "the recording ends before" not in str(whole.events)
    assert "the recording ends before the run" in replay_run(half).events[-1]
