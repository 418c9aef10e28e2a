"""What watching costs a command: from the decision to the acknowledged write, watched and not.

A bench controller asks for another finger speed in every frame, through the real loop, detector and
guard, on the emulated rig. Blocks of one run alternate: nobody, a recorder, and a recorder, the
truth of the world and the live panel on a terminal of its own.
"""

import os
import subprocess
from bisect import bisect_right
from pathlib import Path

import pytest

from detector.scores.quantiles import quantile
from drivers.interfaces import FINGERS, Counts3
from grasp.cli import view
from grasp.commands import Command, MoveFingers, StopArm
from grasp.controller import Decision
from grasp.loop import ControlLoop, Tick
from grasp.messages import CHANNELS, write_tick
from grasp.observation import Observation
from grasp.phases import Phase
from grasp.realtime import real_time
from grasp.recording import RunRecorder
from grasp.slip import DISARMED
from grasp.step import GraspStep
from grasp.watch import Onlooker
from scenarios.campaign.config import load_config
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import make_guard

BLOCK, BLOCKS, COMMANDS = 60, 51, 2000
WHO = ("nobody", "recorder", "recorder, truth and panel")
SHORT_OF_ANYTHING: Counts3 = (20, 20, 20)


class Restless:
    """Asks for other fingers' speed in every step."""

    finished = False
    phase = Phase.APPROACH
    in_safe_state = False

    def __init__(self) -> None:
        self._steps = 0

    def step(self, seen: Observation) -> Decision:
        self._steps += 1
        speed_mps = 0.05 + 0.03 * (self._steps % 2)
        return Decision(
            Phase.APPROACH, DISARMED, (MoveFingers(SHORT_OF_ANYTHING, speed_mps, 10.0),)
        )

    def aborted(self) -> tuple[Command, ...]:
        return (StopArm(1.0),)


class Watchers:
    """Who watches a tick, by block."""

    def __init__(self, rig: Rig, folder: Path, screen: int) -> None:
        self.rig = rig
        self.ticks = 0
        self.recorder = RunRecorder(folder / "bench.mcap", CHANNELS, {})
        self.onlooker = Onlooker(view, screen)
        self.onlooker.tell(view.Begin(panel=True))

    def take(self, tick: Tick) -> None:
        who = self.ticks // BLOCK % len(WHO)
        self.ticks += 1
        if who >= 1:
            write_tick(self.recorder.write, tick)
        if who == 2:
            self.rig.truth()
            self.onlooker.show(view.glimpse(tick, news=self.ticks % 20 == 0))


@pytest.mark.bench
@pytest.mark.timeout(600)
def test_watched_and_unwatched_commands(tmp_path: Path) -> None:
    master, slave = os.openpty()
    sets = ("hand.activation_s=0.5", "gripper.write_interval_s=0.008")
    config = load_config("can", "emulated", None, None, sets).for_lift()
    with (
        subprocess.Popen(["cat"], stdin=master, stdout=subprocess.DEVNULL) as reader,
        open_rig(config, 0, paced=False) as rig,
        real_time(config.realtime),
    ):
        watchers = Watchers(rig, tmp_path, slave)
        step = GraspStep(config.make_detector(FINGERS), Restless(), make_guard(config))
        loop = ControlLoop(rig.devices, rig.clock, step, config.loop, watchers.take)
        began = len(rig.acknowledgements())
        for _ in range(BLOCK * BLOCKS):
            loop.tick()
        loop.abort()
        replies = rig.acknowledgements()[began:]
        watchers.onlooker.close()
        watchers.recorder.close()
        os.close(slave)
        os.close(master)
        reader.kill()
    report(loop, replies, watchers)


def report(loop: ControlLoop, replies: list[tuple[int, int]], watchers: Watchers) -> None:
    commands = loop.timing.gripper_commands_ns
    sent = [sent_ns for _, sent_ns in commands]
    found: dict[str, list[float]] = {who: [] for who in WHO}
    for called_ns, reply_ns in replies:
        i = bisect_right(sent, called_ns) - 1
        found[WHO[i // BLOCK % len(WHO)]].append((reply_ns - commands[i][0]) * 1e-6)
    print(
        f"\n{len(commands)} commands, {len(replies)} acknowledged; decision to acknowledged write"
    )
    for who, values in found.items():
        values.sort()
        p50, p90, p99, most = (quantile(values, share) for share in (0.5, 0.9, 0.99, 1.0))
        figures = f"p50 {p50:.2f}  p90 {p90:.2f}  p99 {p99:.2f}  max {most:.2f}"
        print(f"{who:26} {len(values):5}: {figures}")
    decided_us = quantile(sorted(loop.timing.frame_to_decision_ns), 0.5) * 1e-3
    print(
        f"frame to decision p50 {decided_us:.0f} us, periods missed "
        f"{loop.timing.missed_periods}, frames repeated {loop.timing.repeated_frames}, "
        f"pictures lost {watchers.onlooker.lost}"
    )
    assert len(replies) > COMMANDS
