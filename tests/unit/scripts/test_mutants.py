"""Mutants are what they are called, and every argument is about one that there is."""

import ast
import gc
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from scripts import mutant_tables, mutation_run
from scripts import mutants as mutants_script
from scripts.mutant_parts import PARTS, STRATA, drawn, of_part, of_stratum
from scripts.mutant_tables import (
    BEGINS,
    ENDS,
    PAGE,
    Draw,
    Told,
    arguments,
    draws,
    of_draws,
    of_twice,
    otherwise,
    table,
    together,
    unexplained,
)
from scripts.mutants import Book, digest, progress
from scripts.mutation import HOME, Mutant, mutants, mutated
from scripts.mutation_run import Fate, Fell, Unfit, sure


def made_of(source: str, folder: Path) -> dict[str, list[str]]:
    """By operator, what each mutant of a module makes of it."""
    (folder / "module.py").write_text(source)
    found: dict[str, list[str]] = {}
    for mutant, place in mutants("module.py", folder).items():
        text = ast.unparse(mutated("module.py", place, folder))
        found.setdefault(mutant.operator, []).append(text)
    return found


@pytest.mark.parametrize(
    ("source", "made"),
    [
        ("x = a < b", {"comparison flipped": ["x = a >= b"], "boundary": ["x = a <= b"]}),
        ("x = 0 < a", {"comparison flipped": ["x = 0 >= a"], "boundary": ["x = 0 <= a"],
                       "constant": ["x = 1 < a"]}),
        ("x = a + b", {"arithmetic": ["x = a - b"]}),
        ("x = -a", {"arithmetic": ["x = a"]}),
        ("x = f(1.5, True)", {"constant": ["x = f(3.0, True)", "x = f(1.5, False)"]}),
        ("x = not a", {"boolean negation": ["x = a"]}),
        ("x = a and b", {"boolean negation": ["x = a or b"]}),
        ("x = b if a else c", {"boolean negation": ["x = b if not a else c"]}),
        ("x = min(a, b)", {"extremum": ["x = max(a, b)"]}),
        ("x = np.maximum(a, b)", {"extremum": ["x = np.minimum(a, b)"]}),
        ("x: Annotated[int, Meta(ge=1)]", {}),
        ("class A(Protocol):\n    x = 1", {}),
        ("x = zip(a, b, strict=True)", {}),
        ("x = f'{a + 1}'", {}),
        ("__all__ = ['a']", {}),
    ],
)  # fmt: skip
def test_each_operator_changes_one_place(
    source: str, made: dict[str, list[str]], tmp_path: Path
) -> None:
    found = made_of(source, tmp_path)
    if source.startswith("x ="):
        found.pop("statement deleted")
    assert found == made


def test_statements_are_deleted_and_values_not_returned(tmp_path: Path) -> None:
    found = made_of("def f():\n    x = g()\n    h()\n    return x\n", tmp_path)
    bodies = [text.split("\n    ")[1:] for texts in found.values() for text in texts]
    assert sorted(bodies) == [
        ["pass", "h()", "return x"], ["x = g()", "h()", "return None"],
        ["x = g()", "pass", "return x"],
    ]  # fmt: skip


def test_mutants_of_one_function_have_different_names() -> None:
    for part in PARTS.values():
        names = [str(mutant) for mutant in of_part(part)]
        assert len(set(names)) == len(names)


def test_every_argument_is_about_a_mutant_that_there_is() -> None:
    paths = sorted({name.split()[0] for name in arguments()})
    there = {str(mutant) for path in paths for mutant in mutants(path, HOME)}
    assert arguments().keys() <= there


def test_a_sample_is_the_same_whenever_it_is_drawn() -> None:
    for name, stratum in STRATA.items():
        assert drawn(name, 5) == drawn(name, 5) != drawn(name, 6)
        assert len(drawn(name, 5)) == stratum.mutants


def test_parts_and_strata_have_every_module_of_grasp_and_drivers_once() -> None:
    paths = [path for part in PARTS.values() for path in part.paths]
    for name in STRATA:
        paths += sorted({mutant.path for mutant in of_stratum(name)})
    assert len(set(paths)) == len(paths)
    sampled = set(paths) - {path for part in PARTS.values() for path in part.paths}
    assert {path for path in sampled if "/link/" in path or path.startswith("grasp/cli/")} == {
        mutant.path for name in ("command-line", "wires") for mutant in of_stratum(name)
        if "/emulator/" not in mutant.path
    }  # fmt: skip
    every = {str(path.relative_to(HOME)) for top in ("grasp", "drivers")
             for path in (HOME / top).rglob("*.py")}  # fmt: skip
    assert {path for path in every - set(paths) if mutants(path, HOME)} == set()


def test_survivor_needs_an_argument_and_an_argument_a_survivor() -> None:
    mutant = of_part(PARTS["guard"])[0]
    lived, died = Fate(mutant, "", 3), Fate(mutant, "a test", 3)
    assert unexplained([lived], {})
    assert not unexplained([lived], {str(mutant): "why"})
    assert unexplained([died], {str(mutant): "why"})
    assert not unexplained([died], {})


def test_fates_found_out_twice_are_compared_by_whether_a_test_sees_them() -> None:
    a, b = of_part(PARTS["guard"])[:2]
    first = [Fate(a, "a test", 3), Fate(b, "", 3)]
    assert otherwise(first, [Fate(a, "another", 3), Fate(b, "", 3)]) == []
    assert otherwise(first, [Fate(b, "a test", 3)]) == [f"{b}: survived, then killed"]


def test_a_test_that_was_written_meanwhile_is_no_chance(tmp_path: Path) -> None:
    test = tmp_path / "test_it.py"
    test.write_text("")
    before = digest([str(test)])
    assert digest([str(test)]) == before
    test.write_text("assert True")
    assert digest([str(test)]) != before
    assert digest([str(tmp_path)]) == digest([str(test)])
    mutant = of_part(PARTS["guard"])[0]
    then, now = Fate(mutant, "", 3, "before"), Fate(mutant, "a test", 3, "after")
    assert otherwise([then], [now]) == []


def test_each_stratum_counts_by_its_number_of_mutants() -> None:
    small = Draw("small", 1, "abc", 100, 12, 2, 5)
    large = Draw("large", 1, "abc", 300, 50, 0, 40, since=8)
    rate, low, high = together([small, large])
    assert rate == pytest.approx(0.25 * 0.5 + 0.75 * 0.8)
    assert low < rate < high
    widths = [high - low for _, low, high in (small.rate, large.rate, (rate, low, high))]
    assert widths[1] * 0.75 < widths[2] < 0.25 * widths[0] + 0.75 * widths[1]
    assert together([large]) == pytest.approx(large.rate)
    page = of_draws([small, large])
    assert "| small | 1 | abc | 12 of 100 | 2 | 5 of 10 | 50 (24 to 76) | 0 | 5 |" in page
    assert "| large | 1 | abc | 50 of 300 | 0 | 40 of 50 |" in page
    assert "by its number of mutants: 73 (" in page


def test_an_older_draw_stays_on_the_page_and_only_the_latest_counts_in_the_sum() -> None:
    old, new = Draw("one", 1, "abc", 100, 10, 0, 1), Draw("one", 2, "def", 100, 10, 0, 9)
    page = of_draws([old, new])
    assert "| one | 1 | abc |" in page and "| one | 2 | def |" in page
    assert "number of mutants: 90 (" in page


def test_page_and_make_tell_of_the_draw_that_was_looked_at() -> None:
    page = PAGE.read_text(encoding="utf-8")
    shown = page.partition(BEGINS.format("samples"))[2].partition(ENDS.format("samples"))[0]
    assert set(of_draws(draws()).splitlines()) <= set(shown.splitlines())
    asked = re.search(r"^MUTANTS_SEED \?= (\d+)$", (HOME / "Makefile").read_text(), re.MULTILINE)
    latest = {draw.stratum: draw.seed for draw in draws()}
    assert asked is not None
    assert latest == dict.fromkeys(latest.keys() & STRATA, int(asked[1]))


@pytest.fixture
def history(monkeypatch: pytest.MonkeyPatch) -> None:
    """At each commit but "old" all files were as they are."""

    def said(show: str, what: str) -> str:
        commit, _, path = what.partition(":")
        return "other" if commit == "old" else (HOME / path).read_text(encoding="utf-8")

    monkeypatch.setattr(mutant_tables, "git", said)
    monkeypatch.setattr(mutant_tables, "unchanged", mutant_tables.unchanged.__wrapped__)


@pytest.mark.usefixtures("history")
def test_table_of_parts_says_how_many_were_run_and_where() -> None:
    told = Told({name: [Fate(m, "a test", 3, "", "new") for m in of_part(p)]
                 for name, p in PARTS.items()})  # fmt: skip
    guard = len(told.parts["guard"])
    whole = table(told)
    assert f"| guard | new | {guard} | {guard} | {guard} | 0 | 0 | 0 |" in whole
    first = told.parts["guard"].pop(0)
    assert f"| guard | new | {guard} | {guard - 1} | {guard - 1} | 0 | 0 | 0 |" in table(told)
    told.parts["guard"].append(msgspec.structs.replace(first, commit="newer"))
    assert f"| guard | new, newer | {guard} | {guard} | {guard} | 0 | 0 | 0 |" in table(told)
    told.parts["guard"][-1] = msgspec.structs.replace(first, commit="old")
    assert f"| guard | new | {guard} | {guard - 1} |" in table(told)
    assert table(Told()) == ""


@pytest.mark.usefixtures("history")
def test_row_of_a_part_that_is_not_known_stays_while_its_files_do() -> None:
    told = Told({"step": [Fate(m, "a test", 3, "", "new") for m in of_part(PARTS["step"])]})
    for commit, stays in (("new", True), ("old", False)):
        row = f"| guard | {commit} | 9 | 8 | 7 | 6 | 5 | 4 |"
        assert (row in table(told, f"| part |\n{row}\n")) is stays
    assert "| guard | - | " in table(told, row)


@pytest.mark.usefixtures("history")
def test_fates_of_a_file_that_has_changed_are_found_out_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mutants_of = of_part(PARTS["guard"])[:3]
    asked_for = list[Mutant]()
    monkeypatch.setattr(
        mutants_script, "run", lambda tests, chosen, most_s, tell: asked_for.extend(chosen)
    )
    fates = [Fate(mutants_of[0], "a", 3, "", "new"), Fate(mutants_of[1], "a", 3, "", "old")]
    Book(tmp_path / "fates.json").attack("guard", fates, mutants_of)
    assert asked_for == mutants_of[1:]


def test_fates_found_out_twice_are_told_with_those_that_differ() -> None:
    a, b, _ = drawn("rest", 5)[:3]
    told = Told({"rest": [Fate(a, "a test", 3), Fate(b, "", 3)]})
    assert of_twice(told) == ""
    told.twice = {"rest": [Fate(a, "other", 3), Fate(b, "new", 3)]}
    assert "| rest | 2 | 1 | 0 |" in of_twice(told)
    assert f"- `{b}: survived, then killed`" in of_twice(told)


class Fails:
    """Which of the tests fail, whenever they run, and how often with the mutant."""

    def __init__(self, always: str = "", with_mutant: dict[str, int] | None = None) -> None:
        self._always, self._left = always, with_mutant or {}

    def __call__(self, names: Sequence[str], changed: bool) -> Fell | None:
        for name in names:
            if changed and self._left.get(name, 0):
                self._left[name] -= 1
                return Fell(name)
            if name in self._always:
                return Fell(name)
        return None


def test_what_kills_fails_twice_with_the_mutant_and_not_without() -> None:
    assert sure(Fails(with_mutant={"b": 2}), "abc") == "b"
    assert sure(Fails(), "abc") == ""
    assert sure(Fails(), "") == ""


def test_a_test_that_fails_by_itself_kills_nothing_and_others_are_asked() -> None:
    assert sure(Fails(always="a"), "abc") == ""
    assert sure(Fails(always="a", with_mutant={"c": 2}), "abc") == "c"
    assert sure(Fails(with_mutant={"a": 1}), "abc") == ""
    assert sure(Fails(with_mutant={"a": 1}), "a") == ""
    assert sure(Fails(always="b", with_mutant={"a": 1}), "ab") == ""
    assert sure(Fails(with_mutant={"a": 1, "b": 2}), "abc") == "b"


def test_of_a_file_that_cannot_be_imported_one_test_is_asked_once_more() -> None:
    asked_of = list[Sequence[str]]()

    def imports(names: Sequence[str], changed: bool) -> Fell | None:
        asked_of.append(names)
        return Fell("b") if changed else None

    assert sure(imports, ["a::1", "b::1", "b::2"]) == "b"
    assert asked_of == [["a::1", "b::1", "b::2"], ["b::1"], ["b::1"]]


def test_a_mutant_of_which_no_test_can_tell_has_not_survived() -> None:
    with pytest.raises(Unfit, match="without a mutant too: a, b, c"):
        sure(Fails(always="abc"), "abc")


@pytest.mark.parametrize("how", ["time-out", "broken"])
def test_a_mutant_with_which_tests_do_not_end_is_killed_if_they_do_not_once_more(how: str) -> None:
    def ends(names: Sequence[str], changed: bool) -> Fell | None:
        return Fell("", how) if changed else None

    assert sure(ends, "abc") == how
    once = iter([Fell("", how), None, None])
    assert sure(lambda names, changed: next(once), "abc") == ""
    named = iter([Fell("b", how), None, Fell("b", how)])
    assert sure(lambda names, changed: next(named), "abc") == how
    with pytest.raises(Unfit, match=f"without a mutant too: {how}"):
        sure(lambda names, changed: Fell("", how), "abc")


def of_describe(what: str) -> Mutant:
    """One that returns nothing."""
    mutants_of = [m for m in of_part(PARTS["loop"]) if m.where == "describe"]
    return next(m for m in mutants_of if m.operator == "return value" and what in m.was)


DESCRIBED = """
import threading
from grasp.commands import CloseFast, MoveArm, MoveFingers, describe

def test_fails():
    assert describe(MoveArm((0.0, 0.0, 0.0), 1.0, 1.0)) is not None

def test_waits():
    if describe(MoveFingers((1, 2, 3), 1.0, 1.0)) is None:
        threading.Event().wait()

def test_computes():
    while describe(CloseFast(1.0, (True, True, True), (1, 2, 3), 1.0)) is None:
        pass
"""


def test_a_mutant_that_waits_or_computes_for_ever_ends_by_its_time_out_and_those_after_it_are_seen(
    tmp_path: Path,
) -> None:
    (tmp_path / "test_described.py").write_text(DESCRIBED)
    program = (
        "import sys\n"
        "import scripts.mutation_run as r\n"
        "from tests.unit.scripts.test_mutants import of_describe\n"
        "r.IDLE_S, r.LOOK_S, r.LEAST_CPU_S = 1.0, 0.25, 1.0\n"
        "def tell(fate):\n    print(fate.killer.rpartition(':')[2])\n"
        "chosen = [of_describe(what) for what in ('close', 'fingers to', 'arm to')]\n"
        f"r.run(['{tmp_path}'], chosen, 30.0, tell)\n"
    )
    made = subprocess.run(
        (sys.executable, "-c", program), cwd=HOME, capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    assert made.stdout.split() == ["time-out", "time-out", "test_fails"]


@pytest.mark.parametrize(
    ("body", "killer"),
    [("import threading\n    threading.Event().wait()", "time-out"),
     ("assert False", "test_it.py::test_it"),
     ("import os\n    os._exit(3)", "broken"),
     ("import os, signal\n    os.kill(os.getpid(), signal.SIGKILL)", "time-out"),
     ("import time\n    end = time.process_time() + 1.5\n    while time.process_time() < end:"
      "\n        pass", "")],
)  # fmt: skip
def test_tests_in_a_copy_are_late_if_they_wait_and_not_because_they_compute(
    body: str, killer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And nothing of them is left open: pytest would blame the next test for it."""
    mutant = of_describe("arm to")
    (tmp_path / mutant.path).parent.mkdir()
    (tmp_path / mutant.path).write_text("")
    (tmp_path / "test_it.py").write_text(f"def test_it():\n    {body}\n")
    monkeypatch.setattr(mutation_run, "_copy", lambda: tmp_path)
    monkeypatch.setattr(mutation_run, "IDLE_S", 0.75)
    monkeypatch.setattr(mutation_run, "LOOK_S", 0.25)
    place = mutants(mutant.path)[mutant]
    fell = mutation_run.in_copy(mutant, place, 0.0, ["test_it.py"], True)
    gc.collect()
    assert (fell.killer if fell else "") == killer
    assert (tmp_path / mutant.path).read_text() == ""


def asked(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["mutants.py", *words])
    return mutants_script.main()


@pytest.mark.parametrize(
    "words",
    ["run --part guard --most 4", "run --part rest", "sample --part guard", "sample --most 0",
     "page --part guard", "after --most 4"],
)  # fmt: skip
def test_a_word_that_a_verb_would_not_heed_is_refused(
    words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit) as ended:
        asked(monkeypatch, *words.split())
    assert ended.value.code == 2


@pytest.mark.parametrize("verb", ["page", "twice", "after"])
def test_fates_that_are_not_there_are_missed(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mutants.json"
    assert asked(monkeypatch, verb, "--out", str(out)) == 2
    assert capsys.readouterr().err.startswith(f"mutants: {out}: No such file")
    out.write_text("[1]")
    assert asked(monkeypatch, verb, "--out", str(out)) == 2
    assert capsys.readouterr().err.startswith(f"mutants: {out}: ")


def test_ctrl_c_ends_all_parts_and_says_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, begun = tmp_path / "mutants.json", list[str]()

    def interrupted(
        tests: Sequence[str], chosen: Sequence[Mutant], most_s: float, tell: Callable[[Fate], None]
    ) -> None:
        begun.append(chosen[0].path)
        tell(Fate(chosen[0], "a test", 1))
        raise KeyboardInterrupt

    monkeypatch.setattr(mutants_script, "run", interrupted)
    assert asked(monkeypatch, "run", "--out", str(out)) == 130
    assert begun == ["grasp/guard.py"]
    said = capsys.readouterr().err
    assert said == f"mutants: 1 fates kept in {out}; the same command goes on\n"
    assert len(Book(out).told.parts["guard"]) == 1


@pytest.mark.parametrize(("ends", "code"), [("", 0), ("import signal, os\n", -2)])
def test_pytest_does_not_keep_ctrl_c_to_itself_nor_a_killed_mutant_look_like_a_failing_test(
    ends: str, code: int
) -> None:
    """In a process of its own: pytest runs within pytest here otherwise."""
    program = (
        f"{ends}from scripts.mutant_parts import PARTS, of_part\n"
        "from scripts.mutation_run import run\n"
        "def tell(fate):\n    print(bool(fate.killer))\n"
        + ("    os.kill(os.getpid(), signal.SIGINT)\n" if ends else "")
        + "chosen = [m for m in of_part(PARTS['guard']) if 'flipped' in m.operator][:2]\n"
        "run(['tests/unit/grasp/test_guard.py'], chosen, 30.0, tell)\n"
    )
    made = subprocess.run(
        (sys.executable, "-c", program), cwd=HOME, capture_output=True, text=True, check=False
    )
    assert made.returncode == code, made.stderr
    # of two mutants, or the one until then, and not a letter of what pytest shows of tests
    before, _, _ = made.stdout.partition("!!!")  # which is how it says that it was interrupted
    assert before.split() == ["True"] * (1 if ends else 2)


def test_progress_tells_killed_from_survived() -> None:
    fates = [Fate(mutant, killer, 1) for mutant, killer in
             zip(of_part(PARTS["guard"]), ("a test", "", "time-out"), strict=False)]  # fmt: skip
    assert progress(fates, 80) == "3 of 80 mutants: 2 killed, 1 survived"
