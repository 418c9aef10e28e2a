"""Settings of the modelled hand: everything that no manual states, each with source and range."""

from typing import Annotated, Literal

import msgspec

_Meta = msgspec.Meta
_Offset = Annotated[int, _Meta(ge=-5, le=5)]


class HandSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The reference hand. "manual": Robotiq 3-Finger manual, 2014 or 2018; "assumed": no source."""

    # Registers and time
    refresh_hz: Annotated[
        Literal[100, 200],
        _Meta(description="rate at which registers are latched, Hz; manual p. 75 (100), FC23 200"),
    ] = 100
    tick_phase_s: Annotated[
        float, _Meta(ge=0, lt=0.01, description="refresh ticks against time zero, s; assumed")
    ] = 0.005
    command_latency_s: Annotated[
        float, _Meta(ge=0, le=0.15, description="from take-up to motor, s; assumed")
    ] = 0.03
    boot_s: Annotated[
        float, _Meta(ge=0, le=60, description="fault 0x09 after power-up lasts, s; assumed")
    ] = 0.0
    activation_s: Annotated[
        float, _Meta(ge=0, le=30, description="duration of activation, s; assumed")
    ] = 6.0
    mode_change_s: Annotated[
        float, _Meta(ge=0, le=30, description="duration of a mode change, s; assumed")
    ] = 3.0
    scissor_speed_counts_ps: Annotated[
        float, _Meta(ge=10, le=1000, description="speed of the scissor axis, 1/s; assumed")
    ] = 100.0

    # Position
    m_per_count: Annotated[
        float,
        _Meta(ge=0.0003, le=0.0012, description="fingertip travel of a count, m; Franchi TR711"),
    ] = 0.00077
    open_limit_counts: Annotated[
        int, _Meta(ge=0, le=20, description="software limit of opening; manual p. 74, 6 to 7")
    ] = 6
    closed_limit_counts: Annotated[
        int, _Meta(ge=200, le=255, description="software limit of closing; Franchi TR711")
    ] = 240
    offset_counts: Annotated[
        tuple[_Offset, _Offset, _Offset],
        _Meta(description="zero of each finger's encoder, counts, -5 to 5; manual p. 74 shows 1"),
    ] = (0, 0, 0)

    # Motors
    least_speed_mps: Annotated[
        float, _Meta(ge=0.001, le=0.1, description="fingertip speed of byte 0, m/s; manual")
    ] = 0.022
    speed_step_mps: Annotated[
        float,
        _Meta(ge=1e-5, le=1e-3, description="speed of a count, m/s; manual, 88 mm/s over 255"),
    ] = 0.000345
    speed_lag_s: Annotated[
        float,
        _Meta(ge=0.001, le=0.2, description="lag of the motor's speed, s; assumed 20 to 50 ms"),
    ] = 0.03
    tip_mass_kg: Annotated[
        float, _Meta(ge=0.02, le=2, description="motor and links as seen at the tip, kg; assumed")
    ] = 0.1
    servo_gain_nspm: Annotated[
        float, _Meta(ge=1000, le=50000, description="stiffness of the speed servo, N s/m; assumed")
    ] = 5000.0

    # Force
    least_force_n: Annotated[
        float, _Meta(ge=1, le=30, description="true static force of byte 0, N; Grover 2022")
    ] = 10.0
    most_force_n: Annotated[
        float, _Meta(ge=15, le=80, description="true static force of byte 255, N; manual p. 47")
    ] = 60.0
    force_exponent: Annotated[
        float, _Meta(ge=0.3, le=3, description="curve of byte to true force; assumed linear")
    ] = 1.0
    current_clamp: Annotated[
        bool, _Meta(description="motor current is limited at once, not by detection alone; assumed")
    ] = True
    override_s: Annotated[
        float,
        _Meta(ge=0, le=0.3, description="force overridden at start, s; manual p. 47, assumed"),
    ] = 0.0
    override_n: Annotated[
        float, _Meta(ge=0, le=80, description="force while it is overridden, N; assumed")
    ] = 30.0

    # Object detection
    debounce_s: Annotated[
        float, _Meta(ge=0.001, le=0.2, description="stall to reported contact, s; assumed")
    ] = 0.03
    stall_speed_mps: Annotated[
        float, _Meta(ge=1e-5, le=0.01, description="speed below which it stalls, m/s; assumed")
    ] = 0.001
    misses_contact: Annotated[
        bool,
        _Meta(description="contact is reported as 'at target', as thin objects may be; assumed"),
    ] = False

    # Current, as reported
    running_current_ma: Annotated[
        tuple[float, float],
        _Meta(description="moving freely at 0 and at full speed, mA; manual p. 68-73"),
    ] = (110.0, 160.0)
    current_ma_per_n: Annotated[
        float, _Meta(ge=0, le=100, description="rise of current with drive force, mA/N; assumed")
    ] = 20.0

    def __post_init__(self) -> None:
        if self.most_force_n <= self.least_force_n:
            raise ValueError("most_force_n must exceed least_force_n")
        if any(not -5 <= offset <= 5 for offset in self.offset_counts):
            raise ValueError("offset_counts must lie within -5 and 5")

    def force_n(self, byte: int) -> float:
        """True static force at which the motor of a finger stalls, N."""
        span = self.most_force_n - self.least_force_n
        return float(self.least_force_n + span * (byte / 255) ** self.force_exponent)

    def speed_mps(self, byte: int) -> float:
        return self.least_speed_mps + self.speed_step_mps * byte
