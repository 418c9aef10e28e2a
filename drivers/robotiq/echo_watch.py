"""Watch over the echo of the gripper's status: take-up of our writes, and other clients' writes."""

from drivers.robotiq.protocol import CommandRegisters, StatusRegisters

RESET = CommandRegisters()
ACTIVATE = CommandRegisters(activate=True)

_MOTION_START_NS = 500_000_000  # a commanded motion has started by then; assumed
_NEVER_NS = -(1 << 62)

Echo = tuple[int, ...]  # rGTO and targets (gPR)


class EchoWatch:
    """Compares the echo in each status with the registers that were written last.

    The status shows neither rICF nor speeds and forces. So another client's write is recognized by
    an echo that was not written here, or by a finger that starts to move without a command.
    """

    def __init__(self, refresh_ns: int) -> None:
        self._refresh_ns = refresh_ns
        self._commanded: CommandRegisters | None = None  # last written and still requested
        self.written_ns = _NEVER_NS  # time of the last write
        self._echo: Echo = (-1,) * 4  # in the last status
        self._own_echoes: set[Echo] = set()  # possible until the last write is taken up
        self._foreign_echo: Echo | None = None  # echo of another client's write
        self._stationary: tuple[bool, ...] = ()  # each finger, in the last status
        self.moving = False  # a finger moved in the last status
        self._echo_will_change = False
        self.compared: StatusRegisters | None = None  # the last status that was compared
        self.current = True  # the status is known to reflect the last write
        self.unconfirmed = False  # no status has reflected the last write yet
        self.overwritten = ""  # first sign of another client's write since it was cleared

    @property
    def motion_commanded(self) -> bool:
        """Whether the last write commands positions and is still requested."""
        return self._commanded is not None and self._commanded.go_to

    def refreshed_twice(self, now_ns: int) -> bool:
        """Whether the device has refreshed its registers twice since the last write."""
        return now_ns - self.written_ns >= 2 * self._refresh_ns

    def forget(self) -> None:
        """Expect nothing any more: nothing is requested."""
        self._commanded = self._foreign_echo = None
        self._own_echoes.clear()

    def expect(self, command: CommandRegisters, now_ns: int) -> None:
        """Expect the echo of these registers, which have been written."""
        self._own_echoes |= {self._echo, self._expected_echo()}
        self._commanded = command
        # An echo confirms take-up only if it has to change and the previous one was confirmed.
        changes = self._echo[1:] != self._expected_echo()[1:]
        self._echo_will_change = self.current and command.go_to and changes
        self.current, self.unconfirmed = False, True
        self.written_ns = now_ns

    def update(self, status: StatusRegisters, now_ns: int) -> bool:
        """Update whether the status reflects the last write; until then it may describe the
        previous motion. Returns whether to write again because of another client."""
        a, b, c = status.a, status.b, status.c
        were_stationary = self._stationary
        self._stationary = (a.detection != 0, b.detection != 0, c.detection != 0)
        self.moving = False in self._stationary
        was_current = self.current  # false after a new write
        self.compared, self._echo = status, (int(status.go_to), a.echo, b.echo, c.echo)
        expected = self._expected_echo()
        conclusive = was_current or self._echo_will_change or self.refreshed_twice(now_ns)
        self.current = conclusive and expected == self._echo
        self.unconfirmed = self.unconfirmed and not self.current
        if self.current:
            self._own_echoes.clear()
            self._foreign_echo = None
        if self._echo != expected and self._is_foreign(expected, status, now_ns):
            if self._foreign_echo is None:
                self.overwritten = _difference(self._echo, expected)
            self._foreign_echo = self._echo
            return True
        started = (True, False) in zip(were_stationary, self._stationary, strict=False)
        unrequested = started and was_current and self.current and self.motion_commanded
        if unrequested and now_ns - self.written_ns > _MOTION_START_NS:
            self.overwritten = "a finger moves without a command"
        return unrequested

    def _is_foreign(self, expected: Echo, status: StatusRegisters, now_ns: int) -> bool:
        """Whether a status with another echo shows values that were not written here.

        Values from before the last write are accepted, since that may not be taken up yet. For two
        refreshes, so are mixtures of recent writes and a foreign value already overwritten.
        """
        commanded, echo = self._commanded, self._echo
        if commanded is None or commanded in (RESET, ACTIVATE):
            return False
        if not status.ready or status.mode != commanded.mode:  # targets are not obeyed
            return False
        if self.refreshed_twice(now_ns):
            return echo == self._foreign_echo or echo not in self._own_echoes
        columns = zip(echo, expected, *self._own_echoes, strict=True)
        return any(value not in own for value, *own in columns)

    def _expected_echo(self) -> Echo:
        """rGTO and targets that the status should show; targets count only while rGTO is set."""
        command = self._commanded
        if command is None:
            return self._echo
        if not command.go_to:
            return 0, *self._echo[1:]
        return 1, command.a.position, command.b.position, command.c.position


def _difference(echo: Echo, expected: Echo) -> str:
    fields = (("rGTO", echo[0], expected[0]), ("targets", echo[1:], expected[1:]))
    return " and ".join(f"{name} {is_}, expected {own}" for name, is_, own in fields if is_ != own)
