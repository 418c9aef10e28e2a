"""`grasp calibrate` on emulated devices, with the object's true force as the scale.

The hand's lowest force is stored as an upper bound, and no finger is left on the scale."""

import signal
import subprocess
from collections.abc import Iterator

import pytest

from scenarios.campaign.config import load_config
from tests.wire.lab import Lab, emulate, started
from tests.wire.waiting import PATIENCE_S

TRUE_N = 12.5  # of byte 0 of this hand
STRANGE = ("--set", f"hand.least_force_n={TRUE_N}", "--set", "hand.force_exponent=1.3")
CONFIRMED = ("--confirm-motion", "--scale")
NO_FORCE_N = 1e-6  # rounding error between surfaces that touch without force


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate(*STRANGE) as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        found.activate_hand()
        yield found
        found.cell.close()


@pytest.fixture(autouse=True)
def in_place(lab: Lab) -> None:
    """The can is placed where a scale would be."""
    lab.run_confirmed("release")
    lab.cell.ask("place")


def newtons(lab: Lab) -> float:
    return float(lab.ask("truth")["truth"]["normal_n"][0])


def test_least_force_of_the_hand_is_recovered_as_an_upper_bound(lab: Lab) -> None:
    out = lab.file.with_name("hand.toml")
    read: list[float] = []

    def answer(question: str) -> str:
        assert "reading of the scale" in question
        read.append(newtons(lab))
        return f"{read[-1] / 9.80665 * 1e3:.0f} g"

    arguments = ("calibrate", "hand", "--up-to", "16", "--out", str(out), *CONFIRMED)
    done = lab.grasp(*arguments, operator=answer)
    assert done.code == 0, done.err
    assert len(read) == 10
    config = load_config("can", "hardware", "energy", [lab.file], (f"gripper.calibration={out}",))
    known = config.calibration
    assert known is not None
    assert max(read) <= known.least_force_n < 1.08 * TRUE_N
    assert known.byte_at_most(known.least_force_n) == 0


@pytest.mark.parametrize("ctrl_c", [True, False])
def test_calibration_ended_at_a_prompt_leaves_no_finger_on_the_scale(
    lab: Lab, ctrl_c: bool
) -> None:
    """Ended by Ctrl-C, or by the end of its input."""
    out = lab.file.with_name("ended.toml")
    arguments = (
        "calibrate",
        "hand",
        "--up-to",
        "16",
        "--out",
        str(out),
        *CONFIRMED,
        "--config",
        str(lab.file),
    )
    pressed = 0.0
    with started(*arguments, stdin=subprocess.PIPE) as run:
        assert run.stderr is not None and run.stdin is not None
        for line in run.stderr:
            if "reading of the scale" in line and (pressed := newtons(lab)) <= 1.0:
                run.stdin.write("\n")
                run.stdin.flush()
            elif "reading of the scale" in line:
                break
        if ctrl_c:
            run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=PATIENCE_S)  # closes its input
    assert pressed > 1.0
    assert run.returncode == 130, err
    assert "has backed off the scale and stopped at" in err
    assert newtons(lab) < NO_FORCE_N
    assert not out.exists()
