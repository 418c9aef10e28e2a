"""What pictures for viewers add to a recording: room, and processor time of a run."""

import time
from pathlib import Path

import pytest

from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.tap.tap import tap
from scenarios.trial.pictures import Pictures

ROUNDS = 7


def run(scenario: str, runs: Path) -> tuple[int, float]:
    """Bytes of the recording, and seconds of processor time."""
    config = load_config("can", "simulated")
    begun = time.process_time()
    if scenario == "lift":
        result = lift.run(config.for_lift(), 0, runs).result
    else:
        result = tap.run(config.for_tap(), 0, runs).result
    spent = time.process_time() - begun
    assert result is not None and result.recording is not None
    return Path(result.recording).stat().st_size, spent


@pytest.mark.bench
@pytest.mark.timeout(600)
@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_pictures_are_cheap(scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, bare = [], []
    run(scenario, tmp_path)  # compiles
    for _ in range(ROUNDS):
        drawn.append(run(scenario, tmp_path))
        with monkeypatch.context() as patch:
            patch.setattr(Pictures, "write", lambda *_: None)
            bare.append(run(scenario, tmp_path))
    room = drawn[0][0] / bare[0][0]
    cost = min(spent for _, spent in drawn) / min(spent for _, spent in bare)
    print(f"\n{scenario}: {drawn[0][0]} bytes, {room:.3f} of without; least processor time of "
          f"{ROUNDS} {min(s for _, s in drawn):.2f} s, {cost:.3f} of without")  # fmt: skip
