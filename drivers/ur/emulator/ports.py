"""Inputs and outputs of the controller box and the tool, and the speed slider; nothing is wired.

Numbers of the bits and ratios of the analog outputs: "RTDE Guide".
"""

from collections.abc import Mapping

from drivers.ur.emulator.rtde_wire import Values

_SHIFT = {"standard": 0, "configurable": 8, "tool": 16}  # in actual_digital_output_bits
_WIDTH = {"standard": 8, "configurable": 8, "tool": 2}
_CURRENT_A = (0.004, 0.016)  # least, and span, of an output that gives current
_VOLTAGE_V = (0.0, 10.0)


class Ports:
    """What was set, to be read back; inputs are what the control channel says they are."""

    def __init__(self) -> None:
        self.digital_in = 0
        self.digital_out = 0
        self.analog_in = [0.0, 0.0]
        self.analog_ratio = [0.0, 0.0]  # of the outputs, 0 to 1
        self.analog_voltage = [True, True]  # of the outputs; else current
        self.tool_voltage_v = 0
        self.speed_fraction = 1.0

    def take_inputs(self, written: Mapping[str, Values]) -> None:
        """RTDE inputs of one cycle: a mask says which of the values that came with it count."""
        for group, width in _WIDTH.items():
            mask = int(written.get(f"{group}_digital_output_mask", (0,))[0]) & ((1 << width) - 1)
            if mask:
                bits = int(written.get(f"{group}_digital_output", (0,))[0])
                self._set_bits(mask << _SHIFT[group], bits << _SHIFT[group])
        mask = int(written.get("standard_analog_output_mask", (0,))[0])
        types = int(written.get("standard_analog_output_type", (0,))[0])
        for index in (0, 1):
            if mask >> index & 1:
                self.analog_voltage[index] = bool(types >> index & 1)
                ratio = written.get(f"standard_analog_output_{index}", (0.0,))[0]
                self.set_analog(index, float(ratio))
        if int(written.get("speed_slider_mask", (0,))[0]) & 1:
            self.set_speed(float(written.get("speed_slider_fraction", (1.0,))[0]))

    def set_analog(self, index: int, ratio: float) -> None:
        """Beyond 0 to 1, or no number: no effect."""
        if 0.0 <= ratio <= 1.0:
            self.analog_ratio[index] = ratio

    def set_speed(self, fraction: float) -> None:
        """Of the slider. Beyond 0 to 1, or no number: no effect."""
        if 0.0 <= fraction <= 1.0:
            self.speed_fraction = fraction

    def analog_out(self, index: int) -> float:
        """A or V."""
        least, span = _VOLTAGE_V if self.analog_voltage[index] else _CURRENT_A
        return least + span * self.analog_ratio[index]

    @property
    def analog_types(self) -> int:
        """analog_io_types: bits 0 and 1 the inputs, 2 and 3 the outputs; 1 is voltage."""
        first, second = self.analog_voltage
        return 0b11 | first << 2 | second << 3

    def _set_bits(self, mask: int, bits: int) -> None:
        self.digital_out = self.digital_out & ~mask | bits & mask
