"""How soon each plausibility check reports its fault."""

import itertools

import pytest

from grasp.phases import Phase
from tests.unit.scenarios.conftest import Staged
from tests.unit.scenarios.lift.doubt_delays import delay_ms
from tests.unit.scenarios.lift.test_doubt_delays import CASES, WITHIN_MS, staged


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_delays() -> None:
    """From when it could be told from what is normal (`doubt_delays`) to the step that answers, and
    from the fault itself."""
    print("\n| what happens | name | delay, ms: least, most | from the fault on, ms |")
    print("|---|---|---|---|")
    for act, phases, name in CASES:
        delays: list[float] = []
        whole: list[float] = []
        for phase, seed, after in itertools.product(phases, range(3), (5, 12)):
            lift, found = staged(act, phase, after, seed)
            # where all froze, one may have repeated itself just before
            assert found == name or {name, found} == {"fingertips_frozen", "fingertip_dead"}
            delays.append(delay_ms(lift, found))
            whole.append(since_injected_ms(lift))
        assert max(delays) <= WITHIN_MS
        print(f"| {act.__name__} | {name} | {min(delays):.0f}, {max(delays):.0f} | "
              f"{min(whole):.0f}, {max(whole):.0f} |")  # fmt: skip


def since_injected_ms(lift: Staged) -> float:
    assert lift.done_at_ns is not None
    end_ns = next(t.t_ns for t in lift.ticks if t.decision.phase is Phase.FAULT)
    return (end_ns - lift.done_at_ns) / 1e6
