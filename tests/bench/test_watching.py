"""What watching costs a command: frame to decision, decision to acknowledged write.

A bench controller asks for another finger speed in every frame, through the real loop, detector and
guard, on the emulated rig. Blocks of one run alternate: nobody; a recorder; a recorder, the truth
of the world and the live panel on a terminal of its own; and these with the live page in place of
the panel, in a browser where there is one.
"""

import os
import random
import subprocess
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
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
from scenarios.report.live.feed import LiveTrials
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import make_guard
from tests.browser.chromium import BROWSER, Chromium

BLOCK, BLOCKS, COMMANDS = 60, 68, 2700
WHO = ("nobody", "recorder", "recorder, truth and panel", "recorder, truth and page")
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

    def __init__(self, rig: Rig, folder: Path, screen: int, live: LiveTrials) -> None:
        self.rig = rig
        self.live = live
        self.controller = Restless()
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
        if who == 3:
            self.live.watch(tick, self.rig.truth(), self.controller)  # type: ignore[arg-type]


@contextmanager
def looked_at(address: str, folder: Path) -> Iterator[None]:
    """In a browser, or without one by nobody."""
    if BROWSER is None:
        print("\nno Chromium: nobody looks at the page")
        yield
        return
    with Chromium(folder / "profile") as page:
        page.call("Page.navigate", url=address)
        yield
        rows = page.value("document.documentElement.dataset.rows")
        print(f"\n{rows} instants in the browser")
        assert page.complaints == []


@pytest.mark.bench
@pytest.mark.timeout(600)
def test_watched_and_unwatched_commands(tmp_path: Path) -> None:
    master, slave = os.openpty()
    sets = ("hand.activation_s=0.5", "gripper.write_interval_s=0.008")
    config = load_config("can", "emulated", None, None, sets).for_lift()
    live = LiveTrials(config, "watched", 1)
    with (
        looked_at(live.feed.address, tmp_path),
        subprocess.Popen(["cat"], stdin=master, stdout=subprocess.DEVNULL) as reader,
        open_rig(config, 0, paced=False) as rig,
        real_time(config.realtime),
    ):
        watchers = Watchers(rig, tmp_path, slave, live)
        step = GraspStep(config.make_detector(FINGERS), Restless(), make_guard(config))
        loop = ControlLoop(rig.devices, rig.clock, step, config.loop, watchers.take)
        began = len(rig.acknowledgements())
        for _ in range(BLOCK * BLOCKS):
            loop.tick()
        loop.abort()
        replies = rig.acknowledgements()[began:]
        watchers.onlooker.close()
        live.feed.close()
        watchers.recorder.close()
        os.close(slave)
        os.close(master)
        reader.kill()
    report(loop, replies, watchers)


def report(loop: ControlLoop, replies: list[tuple[int, int]], watchers: Watchers) -> None:
    commands = loop.timing.gripper_commands_ns
    sent = [sent_ns for _, sent_ns in commands]
    rounds: list[dict[str, list[float]]] = [
        {who: [] for who in WHO} for _ in range(-(-BLOCKS // len(WHO)))
    ]
    for called_ns, reply_ns in replies:
        i = min(bisect_right(sent, called_ns) - 1, BLOCK * BLOCKS - 1)
        whose = WHO[i // BLOCK % len(WHO)]
        rounds[i // BLOCK // len(WHO)][whose].append((reply_ns - commands[i][0]) * 1e-6)
    found = together(rounds)
    print(
        f"\n{len(commands)} commands, {len(replies)} acknowledged; p50 / p90 / p99 / max of frame "
        "to decision, and of decision to acknowledged write, ms"
    )
    decided: dict[str, list[float]] = {who: [] for who in WHO}
    for i, took_ns in enumerate(loop.timing.frame_to_decision_ns[: BLOCK * BLOCKS]):
        decided[WHO[i // BLOCK % len(WHO)]].append(took_ns * 1e-3)
    for who in WHO:
        acknowledged = quantiles_text(found[who], 2)
        print(f"{who:26} {len(found[who]):5}: {quantiles_text(decided[who], 0)} us; {acknowledged}")
    for share in (0.5, 0.99):
        for who in WHO[1:]:
            print(f"p{100 * share:g} of {who} less nobody's: {apart(rounds, who, share)} ms")
    print(
        f"periods missed {loop.timing.missed_periods}, frames repeated "
        f"{loop.timing.repeated_frames}, pictures lost {watchers.onlooker.lost} and "
        f"{watchers.live.feed.lost}"
    )
    assert len(replies) > COMMANDS


def together(rounds: list[dict[str, list[float]]]) -> dict[str, list[float]]:
    return {who: [ms for one in rounds for ms in one[who]] for who in WHO}


def apart(rounds: list[dict[str, list[float]]], who: str, share: float) -> str:
    """What a quantile differs from that of nobody, with a 95 % interval: rounds of the alternation
    drawn again, for what else the machine does lasts longer than a command."""

    def difference(some: list[dict[str, list[float]]]) -> float:
        of = together(some)
        return quantile(sorted(of[who]), share) - quantile(sorted(of[WHO[0]]), share)

    rng = random.Random(0)
    drawn = sorted(difference(rng.choices(rounds, k=len(rounds))) for _ in range(1000))
    return f"{difference(rounds):+.2f} [{drawn[25]:+.2f}, {drawn[974]:+.2f}]"


def quantiles_text(values: list[float], digits: int) -> str:
    ordered = sorted(values)
    return " / ".join(f"{quantile(ordered, share):.{digits}f}" for share in (0.5, 0.9, 0.99, 1.0))
