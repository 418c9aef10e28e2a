"""`grasp calibrate` at an emulated lab, the object's true force being the scale: what comes out is
what the hand and the pads are, which are not as the packaged files have them."""

import math
import re
import signal
import subprocess
import time
from collections.abc import Iterator

import pytest

from scenarios.campaign.config import load_config
from scenarios.lab.hand import guard_of
from tests.nightly.scales import CONFIRMED, N_PER_G, Lab, true_slope
from tests.wire.lab import PATIENCE_S, emulate, started

TRUE_N = 12.5  # of byte 0 of this hand
STRANGE = ("--set", f"hand.least_force_n={TRUE_N}", "--set", "hand.force_exponent=1.3")
NO_FORCE_N = 1e-6  # what floating point leaves between surfaces that touch and do not press


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate(*STRANGE) as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        found.wake()
        yield found
        found.cell.close()


@pytest.fixture(autouse=True)
def in_place(lab: Lab) -> None:
    """The can stands where a scale would."""
    lab.done("release")
    lab.cell.ask("place")


def test_least_force_of_the_hand_is_recovered_as_an_upper_bound(lab: Lab) -> None:
    out = lab.folder / "hand.toml"
    read: list[float] = []

    def person(question: str) -> str:
        assert "what does the scale say" in question
        read.append(lab.newtons())
        return f"{read[-1] / 9.80665 * 1e3:.0f} g"

    code, shown, said = lab.played(person, "hand", "--up-to", "16", "--out", str(out), *CONFIRMED)
    assert code == 0, said
    assert len(read) == 10
    config = load_config("can", "hardware", "energy", [lab.file], (f"gripper.calibration={out}",))
    known = config.calibration
    assert known is not None
    assert max(read) <= known.least_force_n < 1.08 * TRUE_N
    assert known.byte_at_most(known.least_force_n) == 0
    assert "10 presses of byte 0" in known.source
    assert "95 % below" in shown
    least = math.ceil(known.least_force_n)
    own = said[said.index("for your own file") :].partition("\n\n")[2]
    (lab.folder / "own.toml").write_text(own)
    theirs = load_config("can", "hardware", "energy", [lab.file, lab.folder / "own.toml"])
    assert theirs.calibration == known
    assert theirs.guard.force_limit_n == theirs.controller.grip_force_n == least
    guard_of(theirs)  # would close


WEIGHTS_G = (150, 50, 250, 100, 200, 120)
MISTYPED_G = 310  # for 100


def test_counts_of_a_newton_are_recovered_by_laid_weights_one_of_them_mistyped(lab: Lab) -> None:
    """Nothing moves. The wrong one is asked about as soon as the others tell, by its number."""
    out = lab.folder / "weights.toml"
    lab.cell.ask("take")
    left, again, before = iter(WEIGHTS_G), [], lab.cell.ask("truth")["travel_m"]

    def person(question: str) -> str:
        if "contradicts" in question:
            again.append(question)
            return "100 g"
        lab.lay(0.0)
        if (grams := next(left, None)) is None:
            return ""
        lab.lay(grams * N_PER_G)
        time.sleep(1.0)  # who lays it there does not type at once
        return f"{MISTYPED_G if grams == 100 else grams} g"

    code, shown, said = lab.played(person, "force", "--finger", "A", "--out", str(out))
    assert code == 0, said
    assert len(again) == 1 and again[0].startswith("reading 4, 3.04 N, contradicts the others")
    assert f"{len(WEIGHTS_G)} readings of a scale, 0.49 to 2.45 N" in shown
    found = re.search(r"([\d.]+) counts a newton \[([\d.]+), ([\d.]+)\]", shown)
    assert found is not None
    slope, low, high = map(float, found.groups())
    truth = true_slope([grams * N_PER_G for grams in WEIGHTS_G], *STRANGE[1::2])
    half = (high - low) / 2
    assert half < 0.1 * slope
    assert low - half <= truth <= high + half  # one play in twenty lies outside of 95 %
    config = load_config("can", "hardware", "energy", [lab.file, out])
    assert config.guard.counts_per_newton == slope
    assert lab.cell.ask("truth")["travel_m"] == before


@pytest.mark.parametrize(
    "words", [("hand", "--up-to", "16"), ("force", "--press", "--up-to", "15")], ids=" ".join
)
@pytest.mark.parametrize("how", ["end of input", "Ctrl-C"])
def test_calibration_that_is_ended_at_a_prompt_leaves_no_finger_on_the_scale(
    lab: Lab, words: tuple[str, ...], how: str
) -> None:
    out = lab.folder / "ended.toml"
    whole = ("calibrate", *words, "--out", str(out), *CONFIRMED, "--config", str(lab.file))
    pressed = 0.0
    with started(*whole, stdin=subprocess.PIPE) as run:
        assert run.stderr is not None and run.stdin is not None
        for line in run.stderr:
            if "almost touch" in line:
                run.stdin.write("95\n")
                run.stdin.flush()
            elif "what" in line and (pressed := lab.newtons()) <= 1.0:
                run.stdin.write("\n")
                run.stdin.flush()
            elif "what" in line:
                break
        if how == "Ctrl-C":
            run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=PATIENCE_S)  # closes its input
    assert pressed > 1.0
    assert run.returncode == 130, said
    assert "has backed off the scale and stands, at" in said
    assert f"--confirm-motion --config {lab.file}`" in said
    assert lab.newtons() < NO_FORCE_N
    assert not out.exists()


def test_rule_of_a_still_hold_is_written_and_read(lab: Lab) -> None:
    out = lab.folder / "rule.toml"
    code, shown, said = lab.played(
        lambda question: "", "noise", "--seconds", "36", "--detector", "energy", "--out", str(out),
        "--confirm-motion",
    )  # fmt: skip
    assert code == 0, said
    assert "counts of load" in shown
    config = load_config("can", "hardware", "energy", [lab.file, out])
    assert config.rule.threshold > 0.0
    assert lab.newtons() < NO_FORCE_N  # it has let go
