"""Register exchange with the gripper: requested registers, written registers, confirmed status."""

from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from drivers.errors import LinkLost
from drivers.robotiq.echo_watch import ACTIVATE, RESET, EchoWatch
from drivers.robotiq.protocol import (
    REGISTERS,
    RTU,
    TCP,
    AxisCommand,
    CommandRegisters,
    Registers,
    StatusRegisters,
    to_bytes,
)
from drivers.robotiq.settings import DriverSettings

WriteLog = Callable[[int, Registers], None]  # time and all registers of each new write


class RegisterTransport(Protocol):
    """Moves registers to and from the device. Raises ``LinkLost`` when it does not answer."""

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None: ...

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]: ...


class ExchangeStatistics(msgspec.Struct):
    """Counts since the driver was made."""

    writes: int = 0
    reads: int = 0
    rejected: int = 0  # replies that did not decode as status registers
    link_losses: int = 0
    reconnects: int = 0
    resynced: int = 0  # a command was dropped because the device may have lost it


class Exchange:
    """Writes the requested registers when they differ from those written, then reads the status.

    Every register image but RESET sets rACT, and rACT activates a hand that has lost power: it
    would open and close fully. Therefore only ACTIVATE is written unless a status, at most one
    refresh old, reports an active hand. Power may be lost after that status. Therefore the register
    with rACT is omitted when the status has confirmed its content. A hand that has just lost power
    has 0 there, and the other registers then move nothing.

    That register also holds rICF, without which all fingers obey the bytes of finger A. So the
    whole image is written again when ``watch`` sees another client's write. While a finger moves,
    all other registers are written again at each refresh.
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
        self._whole_writes = settings.whole_writes
        self._log = log
        self._device_register0: int | None = None  # holds rACT; None: not confirmed by the status
        self.requested: CommandRegisters | None = None  # None: leave the device as it is
        self._image: Registers | None = None  # registers of ``requested``
        self._written_image: Registers | None = None
        self._repeated_ns = 0
        self._read_ns = -self._refresh_ns
        self.watch = EchoWatch(self._refresh_ns)
        self._status_registers: Registers | None = None  # of the last status that decoded
        self._status = StatusRegisters()
        self.lost = False
        self.last_write_hex = ""  # latest acknowledged write that changed a register
        self.last_write_ns = 0  # when it was acknowledged
        self.acknowledged_ns = 0  # when the latest write was acknowledged, repeated ones included
        self.statistics = ExchangeStatistics()

    def request(self, command: CommandRegisters | None) -> None:
        """Set the registers that the device shall have.

        An equal request is written again when two refreshes have not confirmed the write, since a
        write can be lost without notice. It omits the register with rACT if that is confirmed: the
        hand may be silent because it has lost power.
        """
        unconfirmed = self.watch.refreshed_twice(self._read_ns) and not self.watch.current
        if command is not None and command == self.requested and self.all_written and unconfirmed:
            self._written_image = None
        self.requested = command
        self._image = None if command is None else command.to_registers()
        if command is None:
            self._written_image = self._device_register0 = None
            self.watch.forget()

    @property
    def requested_fingers(self) -> tuple[AxisCommand, AxisCommand, AxisCommand] | None:
        """Requests for the fingers; None where no motion is requested."""
        command = self.requested
        return (command.a, command.b, command.c) if command and command.go_to else None

    def rewrite(self) -> None:
        """Write all requested registers again at the next poll."""
        self._written_image = self._device_register0 = None

    @property
    def all_written(self) -> bool:
        """Whether everything requested was written."""
        return self._image == self._written_image

    @property
    def confirmed(self) -> bool:
        """Whether everything requested was written and the status reflects it."""
        written = self._image == self._written_image
        return self.watch.current and written and not self.lost

    def settled(self, now_ns: int) -> bool:
        """Whether everything requested was written two register refreshes ago or earlier."""
        return self.all_written and self.watch.refreshed_twice(now_ns)

    def poll(self, now_ns: int) -> StatusRegisters | None:
        """Write at most once, then read; returns None when the reply was not a status.

        If the status shows another client's write, the request is written again after the read.
        Nothing is written while the link is lost, because the device's registers are unknown.
        """
        self.watch.overwritten = ""
        try:
            if not self.lost and self._write_due(now_ns) and self._may_write(now_ns):
                self._write(now_ns)
            status = self._read(now_ns)
            if status is None:
                return None
            confirmed = status is self.watch.compared and self.watch.current  # by an equal status
            rewrite = not confirmed and self._update_confirmation(status, now_ns)
            if rewrite and not self.lost and self._write_due(now_ns):
                self._write(now_ns)
            elif self.watch.moving:
                self._repeat_in_motion(status, now_ns)
        except LinkLost:
            self.statistics.link_losses += not self.lost
            self.lost, self.watch.current, self._device_register0 = True, False, None
            raise
        self.statistics.reconnects += self.lost
        self.lost = False
        return status

    def _write_due(self, now_ns: int) -> bool:
        if self._image is None or self._image == self._written_image:
            return False
        # a write that stops the hand does not wait for the interval
        return self.requested == RESET or now_ns - self.watch.written_ns >= self._interval_ns

    def _may_write(self, now_ns: int) -> bool:
        """Whether writing the request cannot activate the hand by accident."""
        if self.requested in (RESET, ACTIVATE):
            return True
        if now_ns - self._read_ns >= self._refresh_ns:
            status = self._read(now_ns)
            if status is not None:
                self._update_confirmation(status, now_ns)
        return self._status.active

    def _write(self, now_ns: int) -> None:
        image, requested = self._image, self.requested
        if image is None or requested is None:
            return
        if self._log:
            self._log(now_ns, image)
        # Every register is sent, so that no old byte stays in force. Only a confirmed register 0
        # is omitted.
        first = int(image[0] == self._device_register0 and not self._whole_writes)
        self._send(first, image, now_ns)
        self.statistics.writes += 1
        self.watch.expect(requested, now_ns)
        self._written_image = image

    def _repeat_in_motion(self, status: StatusRegisters, now_ns: int) -> None:
        """Write the same image again at each refresh; called while a finger moves.

        Nothing else restores a speed and force that another client has set. The hand does not take
        an equal image for a new request.
        """
        image = self._image
        if not self.watch.motion_commanded or image is None:
            return
        if self.lost or not self.all_written or not status.active:
            return
        if image[0] != self._device_register0 or self._whole_writes:
            return
        if now_ns - max(self._repeated_ns, self.watch.written_ns) >= self._refresh_ns:
            self._send(1, image, now_ns)
            self._repeated_ns = now_ns

    def _send(self, first: int, image: Registers, now_ns: int) -> None:
        self._transport.write(self._link.command_register + first, image[first:], now_ns)
        self.acknowledged_ns = now_ns if self._clock is None else self._clock()
        words = to_bytes(image)[2 * first :].hex()
        if not (first and self.last_write_hex.endswith(words)):  # not a repetition
            self.last_write_hex, self.last_write_ns = words, self.acknowledged_ns

    def _read(self, now_ns: int) -> StatusRegisters | None:
        registers = tuple(self._transport.read(self._link.status_register, REGISTERS, now_ns))
        self.statistics.reads += 1
        if registers != self._status_registers:
            try:
                self._status = StatusRegisters.from_registers(registers)
            except ValueError:
                self.statistics.rejected += 1
                return None
            self._status_registers = registers
        self._read_ns = now_ns
        return self._status

    def _update_confirmation(self, status: StatusRegisters, now_ns: int) -> bool:
        """Compare the status with the last write. Returns whether to write again because of another
        client."""
        if self.watch.update(status, now_ns):
            self.rewrite()
            return True
        if not status.active:
            self._device_register0 = None
        elif self.watch.current and self._written_image is not None:
            self._device_register0 = self._written_image[0]
        return False
