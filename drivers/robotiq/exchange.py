"""One exchange of registers: what is wanted, what was written, what the status is worth."""

from collections.abc import Callable, Sequence
from typing import Annotated, Literal, Protocol

import msgspec
from msgspec import Meta

from drivers.errors import LinkLost
from drivers.robotiq.protocol import (
    REGISTERS,
    RTU,
    TCP,
    CommandRegisters,
    Registers,
    StatusRegisters,
)

RESET = CommandRegisters()
ACTIVATE = CommandRegisters(activate=True)

_SETTLED_NS = 500_000_000  # a commanded motion has begun by then; assumed

WriteLog = Callable[[int, Registers], None]  # time and all registers of each new write


class RegisterTransport(Protocol):
    """Moves registers to and from the device. Raises ``LinkLost`` when it does not answer."""

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None: ...

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]: ...


class DriverSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the driver talks to the gripper. "manual": Robotiq 3-Finger manual, 2014 or 2018."""

    calibration: Annotated[
        str, Meta(description="a name in config/calibrations, or a .toml file of this hand")
    ] = ""
    link: Annotated[
        Literal["tcp", "rtu"], Meta(description="whose register addresses; manual p. 59, 75")
    ] = "tcp"
    refresh_hz: Annotated[
        Literal[100, 200], Meta(description="register refresh counted on, Hz; manual p. 75")
    ] = 100
    write_interval_s: Annotated[
        float, Meta(ge=0.005, le=0.1, description="least time between writes, s; manual p. 75")
    ] = 0.01
    whole_writes: Annotated[
        bool, Meta(description="always write from the first register on (for a hand that needs it)")
    ] = False


class ExchangeStatistics(msgspec.Struct):
    """Counts since the driver was made."""

    writes: int = 0
    reads: int = 0
    rejected: int = 0  # replies that were no status registers
    link_losses: int = 0
    reconnects: int = 0
    resynced: int = 0  # a command was dropped because the device may have lost it


class Exchange:
    """Writes the wanted registers when they differ from those written, then reads the status.

    Every image but RESET sets rACT, which activates a hand that has lost power: it would open and
    close fully. So nothing but ACTIVATE is written unless a status not older than one refresh
    says that the hand is active. Power may be lost after that status: therefore the register of
    rACT is left out where the hand has shown that it holds what is wanted. A hand that has just
    lost power has 0 there, and what comes after it moves nothing.

    That register has rICF too, without which all fingers obey finger A's bytes, and which the
    status does not show, nor speeds and forces. So the whole image is written again when the status
    shows values that this exchange did not write, or when a finger starts to move without a
    command; all other registers are written again at each refresh while a finger moves.
    """

    def __init__(
        self,
        transport: RegisterTransport,
        settings: DriverSettings,
        log: WriteLog | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._link = TCP if settings.link == "tcp" else RTU
        self._interval_ns = round(settings.write_interval_s * 1e9)
        self._refresh_ns = 1_000_000_000 // settings.refresh_hz
        self._whole = settings.whole_writes
        self._log = log
        self._head: int | None = None  # first register, rACT in it, as the device shows it to be
        self.wanted: CommandRegisters | None = None  # that the device shall have; None: what it has
        self._image: Registers | None = None
        self._written: Registers | None = None
        self._written_ns: int | None = None
        self._repeated_ns = 0
        self._read_ns = -self._refresh_ns
        self._commanded: CommandRegisters | None = None  # written last, and still wanted
        self._shown: tuple[int, ...] = (-1,) * 4  # by the status: rGTO and targets
        self._ours: set[tuple[int, ...]] = set()  # values the status may show until take-up
        self._foreign: tuple[int, ...] | None = None  # another client's, as the status shows them
        self._stood: tuple[bool, ...] = ()  # each finger, in the last status
        self._edge = False
        self._proven = True  # the status is known to speak of what was written
        self.unproven = False  # the status has never spoken of what was written last
        self._raw: Registers | None = None  # of the status, once one was understood
        self._status = StatusRegisters()
        self.changed = ""  # by another client: what this exchange detected first
        self.lost = False
        self.acknowledged = ""  # the latest write that was answered and changed something, in hex
        self.changed_ns = 0  # when it was answered
        self.acknowledged_ns = 0  # when the latest write of all was answered
        self.statistics = ExchangeStatistics()

    def want(self, command: CommandRegisters | None) -> None:
        """What is wanted again is written again where two refreshes have not shown that the device
        heard it: a write may be lost on the way, and nobody is told. The register of rACT is left
        out of that too, where it may be: silence may be that of a hand which has lost power."""
        unheard = self._refreshed_twice(self._read_ns) and not self._proven
        if command is not None and command == self.wanted and self.written and unheard:
            self._written = None
        self.wanted = command
        self._image = None if command is None else command.to_registers()
        if command is None:
            self._written = self._commanded = self._head = self._foreign = None
            self._ours.clear()

    def again(self) -> None:
        """What is wanted is written again, whole, whatever was written before."""
        self._written = self._head = None

    @property
    def told_ns(self) -> int:
        """When something was written last; 0: never."""
        return self._written_ns or 0

    @property
    def written(self) -> bool:
        """All that is wanted was written."""
        return self._image == self._written

    @property
    def confirmed(self) -> bool:
        """All that is wanted was written, and the status speaks of it."""
        return self._proven and self._image == self._written and not self.lost

    def settled(self, now_ns: int) -> bool:
        """All that is wanted was written, two register refreshes ago or more."""
        return self._image == self._written and self._refreshed_twice(now_ns)

    def _refreshed_twice(self, now_ns: int) -> bool:
        return self._written_ns is None or now_ns - self._written_ns >= 2 * self._refresh_ns

    def poll(self, now_ns: int) -> StatusRegisters | None:
        """At most one write, then a read. If the status shows another client's write, the write is
        repeated after the read. None when the reply was no status.

        While the link is lost nothing is written: what the device has now is not known.
        """
        self.changed = ""
        try:
            if not self.lost and self._due(now_ns) and self._admits(now_ns):
                self._write(now_ns)
            status = self._read(now_ns)
            again = status is not None and self._prove(status, now_ns)
            if again and not self.lost and self._due(now_ns):
                self._write(now_ns)
            elif status is not None:
                self._repeat_in_motion(status, now_ns)
        except LinkLost:
            self.statistics.link_losses += not self.lost
            self.lost, self._proven, self._head = True, False, None
            raise
        if status is not None:
            self.statistics.reconnects += self.lost
            self.lost = False
        return status

    def _due(self, now_ns: int) -> bool:
        if self._image is None or self._image == self._written:
            return False
        if self._written_ns is None or self.wanted == RESET:
            return True  # what stops a hand waits for no interval
        return now_ns - self._written_ns >= self._interval_ns

    def _admits(self, now_ns: int) -> bool:
        """Whether the device can take what is wanted without activating unasked."""
        if self.wanted in (RESET, ACTIVATE):
            return True
        if now_ns - self._read_ns >= self._refresh_ns:
            status = self._read(now_ns)
            if status is not None:
                self._prove(status, now_ns)
        return self._status.active

    def _write(self, now_ns: int) -> None:
        image, wanted = self._image, self.wanted
        if image is None or wanted is None:
            return
        if self._log:
            self._log(now_ns, image)
        # All registers but one that the device shows to hold the same: no old byte stays in force.
        kept = int(image[0] == self._head and not self._whole)
        self._send(kept, image, now_ns)
        self.statistics.writes += 1
        self._ours |= {self._shown, self._asked()}
        self._commanded = wanted
        # An echo proves take-up only if it has to change, and the one before had been seen.
        self._edge = self._proven and wanted.go_to and self._shown[1:] != self._asked()[1:]
        self._proven, self.unproven = False, True
        self._written, self._written_ns = image, now_ns

    def _repeat_in_motion(self, status: StatusRegisters, now_ns: int) -> None:
        """Write the same image again at each refresh while a finger moves: nothing else takes back
        speed and force that another client set. The hand takes no equal image for a new
        request."""
        told, image = self._commanded, self._image
        if told is None or not told.go_to or image is None or image != self._written or self.lost:
            return
        if all(self._stood) or not status.active or image[0] != self._head or self._whole:
            return
        if now_ns - max(self._repeated_ns, self.told_ns) >= self._refresh_ns:
            self._send(1, image, now_ns)
            self._repeated_ns = now_ns

    def _send(self, first: int, image: Registers, now_ns: int) -> None:
        self._transport.write(self._link.command_register + first, image[first:], now_ns)
        self.acknowledged_ns = now_ns if self._clock is None else self._clock()
        words = "".join(f"{register:04x}" for register in image[first:])
        if not (first and self.acknowledged.endswith(words)):  # else the same registers again
            self.acknowledged, self.changed_ns = words, self.acknowledged_ns

    def _read(self, now_ns: int) -> StatusRegisters | None:
        registers = self._transport.read(self._link.status_register, REGISTERS, now_ns)
        self.statistics.reads += 1
        raw = tuple(registers)
        if raw != self._raw:
            try:
                self._status = StatusRegisters.from_registers(raw)
            except ValueError:
                self.statistics.rejected += 1
                return None
            self._raw = raw
        self._read_ns = now_ns
        return self._status

    def _prove(self, status: StatusRegisters, now_ns: int) -> bool:
        """Update whether the status reflects the last write: before that, it may describe the
        previous motion. Returns whether to write again, after another client."""
        stood, self._stood = self._stood, tuple(finger.detection != 0 for finger in status.fingers)
        was_proven = self._proven  # false after a new write
        self._shown = (int(status.go_to), *(finger.echo for finger in status.fingers))
        asked = self._asked()
        proof = self._proven or self._edge or self._refreshed_twice(now_ns)
        self._proven = proof and asked == self._shown
        self.unproven = self.unproven and not self._proven
        if self._proven:
            self._ours.clear()
            self._foreign = None
        if self._is_foreign(asked, status, now_ns):
            if self._foreign is None:
                self.changed = _difference(self._shown, asked)
            self._foreign = self._shown
            self.again()
            return True
        begun = any(stood and not stands for stood, stands in zip(stood, self._stood, strict=False))
        obeys = self._commanded is not None and self._commanded.go_to
        if begun and was_proven and self._proven and obeys:
            if now_ns - self.told_ns > _SETTLED_NS:
                self.changed = "a finger moves without a command"
            self.again()
            return True
        if not status.active:
            self._head = None
        elif self._proven and self._written is not None:
            self._head = self._written[0]
        return False

    def _is_foreign(self, asked: tuple[int, ...], status: StatusRegisters, now_ns: int) -> bool:
        """Whether the status shows values that this exchange did not write.

        Allowed are values from before the last write, which may not be taken up yet; for two
        refreshes a mixture of recent writes, and a foreign value that is overwritten already."""
        commanded, shown = self._commanded, self._shown
        if shown == asked or commanded is None or commanded in (RESET, ACTIVATE):
            return False
        if not status.ready or status.mode != commanded.mode:  # targets are not obeyed
            return False
        if self._refreshed_twice(now_ns):
            return shown == self._foreign or shown not in self._ours
        return any(value not in own for value, *own in zip(shown, asked, *self._ours, strict=True))

    def _asked(self) -> tuple[int, ...]:
        """rGTO and targets that the status should show; targets count only while rGTO is set."""
        command = self._commanded
        if command is None:
            return self._shown
        if not command.go_to:
            return 0, *self._shown[1:]
        return 1, command.a.position, command.b.position, command.c.position


def _difference(shown: tuple[int, ...], asked: tuple[int, ...]) -> str:
    fields = (("rGTO", shown[0], asked[0]), ("targets", shown[1:], asked[1:]))
    return " and ".join(f"{name} {it}, expected {own}" for name, it, own in fields if it != own)
