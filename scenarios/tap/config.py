"""Everything that a tap can be told."""

import msgspec

from scenarios.rigs.variation import CUT
from scenarios.tap.blows import blow_of, direction_of, nominal_impulse_n_s
from scenarios.tap.settings import TapScoringSettings, TapSettings
from scenarios.trial.config import TrialConfig
from scenarios.world.world_settings import RunPlan


class TapConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one tap."""

    tap: TapSettings = TapSettings()
    tap_scoring: TapScoringSettings = TapScoringSettings()

    def physics(self, seed: int) -> RunPlan | None:
        """As ``TrialConfig.physics``; all taps of an object in one direction are alike."""
        if self.real:
            return None
        from scenarios.trial.physics import planned, run_scene

        tap = self.tap
        direction = direction_of(tap, seed)
        nominal_n_s = nominal_impulse_n_s(
            self.object, self.contact, self.guard.full_grip_n, tap, direction
        )
        blow = blow_of(tap, direction, tap.strength * nominal_n_s, 0.0)
        offset_m = 0.0 if direction == "closing" else CUT * tap.offset_spread_m
        scene = run_scene(self, blow, CUT * tap.spread, offset_m)
        return planned(self, msgspec.structs.replace(scene, mark_height_m=tap.mark_height_m))
