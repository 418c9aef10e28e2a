"""`grasp calibrate` at an emulated lab, the object's true force being the scale: what comes out is
what the hand and the pads are, which are not as the packaged files have them."""

import math
import re
import signal
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.campaign.config import load_config
from scenarios.lab.hand import guard_of
from tests.wire.scenarios.lab.scales import CONFIRMED, N_PER_G, Lab, true_slope
from tests.wire.scenarios.lab.terminal import grasp, started
from tests.wire.scenarios.test_rigs import emulate

TRUE_N = 12.5  # of byte 0 of this hand
STRANGE = ("--set", f"hand.least_force_n={TRUE_N}", "--set", "hand.force_exponent=1.3")
NO_FORCE_N = 1e-6  # what floating point leaves between surfaces that touch and do not press


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate(*STRANGE) as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        found.done("gripper", "activate", "--empty")
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


def test_weak_hand_is_told_in_every_run(lab: Lab) -> None:
    weak = lab.folder / "weak.toml"
    told = '[calibration]\nsource = "scale, ten presses"\nleast_force_n = 9.0\n'
    weak.write_text(f"{told}pressed_bytes = [0]\npresses = 10\n")
    more = ("--config", str(lab.file), "--set", f"gripper.calibration={weak}")
    for how in ("--confirm-motion", "--dry-run"):
        done = grasp("release", how, *more)
        assert done.returncode == 0
        assert "'weak' has force byte 0 press with 9 N, less than the manual's 15 N" in done.stderr
    weak.write_text(told)
    for how in ("--confirm-motion", "--dry-run"):
        done = grasp("gripper", "close", how, *more)
        assert done.returncode == 2
        assert "it does not say that byte 0 was pressed 10 times" in done.stderr


def test_figures_that_nobody_should_believe_move_nothing_but_let_go(lab: Lab) -> None:
    """Byte 255 for 15.1 N: of a run with that limit the hand would press with true 60."""
    lie = lab.folder / "lie.toml"
    lie.write_text(
        '[calibration]\nsource = "edited"\nleast_force_n = 15.0\nmost_force_n = 15.1\n'
        "force_exponent = 3.0\n"
    )
    limits = ("guard.force_limit_n=15.1", "controller.grip_force_n=15.1")
    more = ["--config", str(lab.file)]
    for text in (f"gripper.calibration={lie}", *limits):
        more += ["--set", text]
    rig = ("--rig", "hardware")
    for verb in (
        ("run", "lift", *rig), ("run", "tap", *rig), ("gripper", "close"), ("gripper", "step"),
        ("calibrate", "noise", "--out", str(lab.folder / "none.toml")),
    ):  # fmt: skip
        for how in ("--confirm-motion", "--dry-run"):
            done = grasp(*verb, how, *more)
            assert done.returncode == 2, done.stderr
            assert "press with 15.1 N, less than a third of the manual's 60 N" in done.stderr
    told = grasp("doctor", *rig, *more)
    assert told.returncode != 0
    assert re.search("^FAIL +calibration .*less than a third", told.stdout, re.MULTILINE)
    for how in ("--dry-run", "--confirm-motion"):
        assert grasp("release", how, *more).returncode == 0


def test_too_few_presses_of_a_weak_byte_write_nothing(lab: Lab) -> None:
    out = lab.folder / "few.toml"
    code, _, said = lab.played(
        lambda question: f"{lab.newtons():.2f} N", "hand", "--up-to", "16", "--presses", "4",
        "--out", str(out), *CONFIRMED,
    )  # fmt: skip
    assert code == 2
    assert "less than the manual's 15" in said
    assert not out.exists()


def test_what_is_asked_for_is_checked_before_anything_is_pressed(lab: Lab) -> None:
    out = lab.folder / "strong.toml"
    strong = ("--up-to", "16", "--bytes", "0", "255")
    few = ("--up-to", "16", "--places", "10", "30", "50", "70")
    for words in (("--up-to", "14"), ("--up-to", "61"), strong, few, ()):
        for how in (CONFIRMED, ("--dry-run",)):
            done = grasp(
                "calibrate", "hand", *words, "--out", str(out), *how, "--config", str(lab.file)
            )
            assert done.returncode == 2, done.stderr
    assert lab.newtons() < NO_FORCE_N
    assert not out.exists()


def test_counts_of_a_newton_are_those_of_the_pad(lab: Lab) -> None:
    """As the guard would use them: other presses of the same pad, of a day that the file knows
    nothing of, are told by it as the file says."""

    def person(question: str) -> str:
        if "almost touch" in question:
            return "95"
        newtons = lab.newtons()
        return f"{newtons:.2f} N" if newtons > 0.3 else ""

    def pressed(out: Path) -> tuple[str, list[tuple[float, float]]]:
        code, shown, said = lab.played(
            person, "force", "--press", "--up-to", "15", "--out", str(out), *CONFIRMED
        )
        assert code == 0, said
        found = re.findall(r"^([\d.]+) N: (\d+) counts", said, re.MULTILINE)
        return shown, [(float(newtons), float(counts)) for newtons, counts in found]

    out = lab.folder / "force.toml"
    shown, _ = pressed(out)
    _, others = pressed(lab.folder / "others.toml")
    assert len(others) >= 5
    config = load_config("can", "hardware", "energy", [lab.file, out])
    per_newton = config.guard.counts_per_newton
    assert per_newton == tomllib.loads(out.read_text())["guard"]["counts_per_newton"]
    worst = re.search(r"at most ([\d.]+) N from", shown)
    assert worst is not None
    within_n = 2 * float(worst[1]) + 0.05  # and how a scale is read
    assert within_n < 0.5
    assert all(abs(counts / per_newton - force) < within_n for force, counts in others)


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


def test_travel_of_a_count_is_that_of_the_hand(tmp_path: Path) -> None:
    """Of one that is not as the packaged files have it: the ruler shows the finger's true way, from
    a mark of its own, in half millimetres."""
    true_mm = 0.85
    with emulate("--set", f"hand.m_per_count={true_mm * 1e-3}") as endpoints:
        lab = Lab(endpoints, tmp_path)
        lab.done("gripper", "activate", "--empty")
        asked: list[str] = []

        def person(question: str) -> str:
            if "where is the fingertip" in question:
                asked.append(question)
                travel_mm = 1e3 * lab.cell.ask("truth")["travel_m"][0]
                return f"{round(2 * (150.0 - travel_mm)) / 2:g} mm"
            if "Take the scale away" in question:
                lab.cell.ask("take")
                return ""
            return f"{lab.newtons():.2f} N"

        out = tmp_path / "hand.toml"
        lab.cell.ask("place")
        code, shown, said = lab.played(
            person, "hand", "--up-to", "16", "--places", "10", "30", "50", "70", "90", "--out",
            str(out), *CONFIRMED,
        )  # fmt: skip
        assert code == 0, said
        lab.cell.close()
    assert len(asked) == 5
    found = re.search(r"Travel: 5 places, (\d+) um a count \[(\d+), (\d+)\]", shown)
    assert found is not None, shown
    _, low, high = map(int, found.groups())
    assert low <= 1e3 * true_mm <= high
    assert high - low < 60
    known = load_config(
        "can", "hardware", "energy", [lab.file], (f"gripper.calibration={out}",)
    ).calibration
    assert known is not None
    assert known.m_per_count == pytest.approx(true_mm * 1e-3, rel=0.02)


def test_place_typed_too_high_is_told_with_what_to_type_before_the_finger_presses(
    lab: Lab,
) -> None:
    out = lab.folder / "high.toml"
    typed = iter(["ninety", "140"])
    asked: list[str] = []

    def person(question: str) -> str:
        newtons = lab.newtons()
        if "almost touch" in question:
            asked.append(question)
            assert newtons < 1e-9  # what floats leave of a pad that has let go
            told = re.search(r"type less, (\d+) if", question)
            return next(typed) if told is None else told[1]
        return f"{newtons:.2f} N" if newtons > 0.3 else ""

    code, _, said = lab.played(
        person, "force", "--press", "--up-to", "15", "--out", str(out), *CONFIRMED
    )
    assert code == 0, said
    assert len(asked) == 3
    assert "'ninety' is no whole number" in asked[1]
    assert "on its way to 140, and has backed off" in asked[2]


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
    with started(*whole, asked=True) as run:
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
        _, said = run.communicate(timeout=60)  # closes its input
    assert pressed > 1.0
    assert run.returncode == 130, said
    assert "has backed off the scale and stands, at" in said
    assert f"--confirm-motion --config {lab.file}`" in said
    assert lab.newtons() < NO_FORCE_N
    assert not out.exists()


def test_press_that_is_ended_by_ctrl_c_is_taken_back(lab: Lab) -> None:
    out = lab.folder / "ended.toml"
    words = ("hand", "--up-to", "16", "--out", str(out), *CONFIRMED, "--config", str(lab.file))
    with started("calibrate", *words, asked=True) as run:
        while lab.newtons() < 1.0:
            time.sleep(0.02)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert "has backed off the scale" in said
    assert lab.newtons() < NO_FORCE_N


def test_mistyped_weight_is_asked_about_once_the_others_tell(lab: Lab) -> None:
    out = lab.folder / "typo.toml"
    typed: list[float] = []
    doubted: list[str] = []

    def person(question: str) -> str:
        if "almost touch" in question:
            return "100"
        if "contradicts" in question:
            doubted.append(question)
            return f"{typed[3]:.2f} N"
        newtons = lab.newtons()
        if newtons < 0.3:
            return ""
        typed.append(newtons)
        return f"{newtons / (4 if len(typed) == 4 else 1):.2f} N"

    code, _, said = lab.played(
        person, "force", "--press", "--up-to", "15", "--out", str(out), *CONFIRMED
    )
    assert code == 0, said
    assert [line.startswith("reading 3, ") for line in doubted] == [True], said


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


@pytest.mark.parametrize(
    "words",
    [("hand", "--up-to", "16"), ("force", "--press", "--up-to", "15"), ("noise",)],
    ids=" ".join,
)
def test_dry_run_says_what_would_move_and_nothing_moves_unconfirmed(
    words: tuple[str, ...], lab: Lab
) -> None:
    out = lab.folder / "none.toml"
    whole = ("calibrate", *words, "--out", str(out), "--config", str(lab.file))
    dry = grasp(*whole, "--dry-run")
    assert dry.returncode == 0
    assert "would move " in dry.stdout
    assert grasp(*whole, "--scale" if words[0] != "noise" else "--json").returncode == 2
    assert lab.newtons() < NO_FORCE_N
    assert not out.exists()
