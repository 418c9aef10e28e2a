"""Who strikes the object in a tap, and how what it did comes to be known: a world, or a person."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from grasp.loop import Tick
from grasp.states import SAFE_STATES, State
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import Swing
from scenarios.tap.result import Alarm
from scenarios.tap.scoring import ObjectMotion
from scenarios.tap.settings import TapSettings
from scenarios.trial.person import NEVER_MIND, Operator, read_mark
from scenarios.world.settings import Blow
from scenarios.world.truth import Truth

SIDES = {
    "top": "on the TOP, downwards",
    "side": "on the SIDE, across the closing axis",
    "closing": "ALONG the closing axis, onto the thumb",
}


class Striker(Protocol):
    """Delivers a blow and finds out what it moved."""

    motion: ObjectMotion | None
    impulse_n_s: float | None

    def before(self, tick: Tick) -> None:
        """A tick before the blow."""
        ...

    def strike(self, tick: Tick, truth: Truth | None) -> None: ...

    def after(self, tick: Tick, truth: Truth | None) -> bool:
        """A tick since the blow was asked for; True when all is known."""
        ...


class WorldStrikes:
    """The world delivers the blow and measures what it did."""

    def __init__(self, tap: Callable[[Blow], None], swing: Swing, settings: TapSettings) -> None:
        self.motion: ObjectMotion | None = None
        self.impulse_n_s: float | None = swing.impulse_n_s
        self._tap, self._swing, self._watch_s = tap, swing, settings.watch_s
        self._at_s = 0.0
        self._rest: Truth | None = None

    def before(self, tick: Tick) -> None:
        """Nothing to remember: the world knows."""

    def strike(self, tick: Tick, truth: Truth | None) -> None:
        if truth is None:  # the world is gone, as the next step will hear
            return
        self._rest = truth
        self._at_s = tick.t_ns * 1e-9
        self._tap(self._swing.blow)

    def after(self, tick: Tick, truth: Truth | None) -> bool:
        rest = self._rest
        if truth is None or rest is None:
            return False
        if tick.t_ns * 1e-9 < self._at_s + self._watch_s and truth.touched:
            return False
        down_m = truth.slip_distance_m - rest.slip_distance_m
        across_m = truth.across_m - rest.across_m
        struck_s = self._at_s if truth.struck_s is None else truth.struck_s
        self.motion = ObjectMotion(
            struck_s=struck_s, from_s=truth.moved_from_s, until_s=truth.moved_until_s,
            displacement_m=math.hypot(down_m, across_m), held=truth.touched,
            turned_rad=truth.turn_rad - rest.turn_rad,
            down_m=down_m, across_m=across_m,
        )  # fmt: skip
        return True


class PersonStrikes:
    """A person strikes when asked, and types how far the tape mark has moved.

    When the blow fell is felt: the first change of counts that stands out from those before it.
    When motion ended is not known; an upper bound is assumed.
    """

    def __init__(self, operator: Operator, direction: str, config: TapConfig) -> None:
        self.motion: ObjectMotion | None = None
        self.impulse_n_s: float | None = None  # nobody knows
        self._operator, self._direction = operator, direction
        self._settings, self._period_s = config.tap, config.loop.period_s
        self._last: np.ndarray[tuple[int, ...], np.dtype[np.int16]] | None = None
        self._loudest = 0.0
        self._asked_s = 0.0
        self._felt_s: float | None = None
        self._struck = False
        self._measuring = False
        self._given_up = False

    def before(self, tick: Tick) -> None:
        self._loudest = max(self._loudest, self._change(tick))

    def strike(self, tick: Tick, truth: Truth | None) -> None:
        self._asked_s = tick.t_ns * 1e-9
        self._operator.say(
            f"Tap the object once {SIDES[self._direction]}. When it is still again: Enter"
        )

    def after(self, tick: Tick, truth: Truth | None) -> bool:
        t_s = tick.t_ns * 1e-9
        if tick.decision.state in SAFE_STATES:
            self._give_up()
            return False
        if self._felt_s is None and not self._struck:
            self._feel(tick, t_s)
        line = self._operator.poll()
        if not self._struck:
            self._struck = line is not None
            return False
        if not self._measuring and t_s >= self._watched_from_s(t_s) + self._settings.watch_s:
            self._measuring = True
            self._operator.say("How far has the tape mark moved, in mm? (0: not at all; l: lost)")
            return False
        return self._measuring and line is not None and self._measured(line)

    def _give_up(self) -> None:
        """The question that stands is taken back, so that what happened is told after it."""
        if not self._given_up:
            self._operator.say(NEVER_MIND)
        self._given_up = True

    def _watched_from_s(self, t_s: float) -> float:
        return self._asked_s if self._felt_s is None else self._felt_s

    def _change(self, tick: Tick) -> float:
        """Largest change of a taxel since the last sample, counts."""
        if tick.frame is None:
            return 0.0
        last, self._last = self._last, tick.frame.counts
        return 0.0 if last is None else float(np.abs(self._last - last).max())

    def _feel(self, tick: Tick, t_s: float) -> None:
        if self._change(tick) > self._settings.felt_factor * max(self._loudest, 1.0):
            self._felt_s = t_s - self._period_s

    def _measured(self, line: str) -> bool:
        mark = read_mark(self._operator, line)
        if mark is None:
            return False
        struck_s = self._asked_s if self._felt_s is None else self._felt_s
        self.motion = ObjectMotion(
            struck_s=struck_s, from_s=struck_s, until_s=struck_s + self._settings.motion_bound_s,
            displacement_m=mark.moved_m, held=mark.held,
        )  # fmt: skip
        return True


class TapSequence:
    """Follows a trial: waits for nominal status, has the object struck, watches, says when to set
    it down. Collects the alarms on the way."""

    def __init__(self, settings: TapSettings, wait_s: float, striker: Striker) -> None:
        self.alarms: list[Alarm] = []
        self.before: Truth | None = None  # just before the blow
        self.watched_until_s = 0.0
        self.over = False
        self._settings, self._wait_s, self._striker = settings, wait_s, striker
        self._since_s: float | None = None  # held at the top
        self._nominal_since_s: float | None = None
        self._struck = False

    @property
    def motion(self) -> ObjectMotion | None:
        return self._striker.motion

    @property
    def impulse_n_s(self) -> float | None:
        """Of the blow, N s; None when nobody knows it or none was struck."""
        return self._striker.impulse_n_s if self._struck else None

    def take(self, tick: Tick, truth: Truth | None) -> None:
        """Take one tick; truth is None on hardware."""
        t_s = tick.t_ns * 1e-9
        if self.over:
            return
        self._listen(tick, t_s)
        if self._struck:
            self.watched_until_s = t_s
            self.over = self._striker.after(tick, truth)
        elif tick.decision.state is State.HOLD and not tick.arm.moving:
            self._hold(tick, truth, t_s)

    def _listen(self, tick: Tick, t_s: float) -> None:
        """Keep the stretches of status REGISTERED, and since when it is nominal."""
        slip = tick.decision.slip
        on = bool(self.alarms) and self.alarms[-1].off_s is None
        if slip.registered and not on:
            self.alarms.append(Alarm(t_s, None))
        elif on and not slip.registered:
            self.alarms[-1] = Alarm(self.alarms[-1].on_s, t_s)
        if slip.registered or not slip.armed:
            self._nominal_since_s = None
        elif self._nominal_since_s is None:
            self._nominal_since_s = t_s

    def _hold(self, tick: Tick, truth: Truth | None, t_s: float) -> None:
        self._striker.before(tick)
        self._since_s = t_s if self._since_s is None else self._since_s
        since_s = max(
            self._since_s, t_s if self._nominal_since_s is None else self._nominal_since_s
        )
        if t_s - since_s >= self._settings.nominal_s + self._wait_s:
            self.before = truth
            self._struck = True
            self._striker.strike(tick, truth)
        elif t_s - self._since_s > self._settings.patience_s + self._wait_s:
            self.over = True
