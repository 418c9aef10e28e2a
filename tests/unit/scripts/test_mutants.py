"""Mutants are what they are called, and every argument is about one that there is."""

import ast
from pathlib import Path

import pytest

from scripts.mutants import (
    PARTS,
    Told,
    arguments,
    drawn,
    generated,
    of_part,
    otherwise,
    unexplained,
)
from scripts.mutation import HOME, mutants, mutated
from scripts.mutation_run import Fate


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


def test_sample_is_the_same_whenever_it_is_drawn_and_leaves_out_what_is_whole() -> None:
    assert drawn(5) == drawn(5)
    whole = {path for part in PARTS.values() for path in part.paths}
    assert not whole & {mutant.path for mutant in drawn(300)}


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


def test_page_keeps_what_came_of_the_sample_at_first_beside_what_tests_kill_since() -> None:
    a, b, c = drawn(3)
    told = Told({"sample": [Fate(a, "a test", 3), Fate(b, "", 3), Fate(c, "", 3)]})
    assert "1 of 3 that are not equivalent were killed at first: 33 %" in generated(told)
    told.after = [Fate(b, "new", 4), Fate(c, "", 4)]
    page = generated(told)
    assert "1 of 3 that are not equivalent were killed at first: 33 %" in page
    assert "Of the 2 that survived at first, tests written since kill 1, 0 have an" in page
    told.twice = {"sample": [Fate(a, "other", 3), Fate(b, "new", 3)]}
    assert "| sample | 2 | 1 | 0 |" in generated(told)
    assert f"- `{b}: survived, then killed`" in generated(told)
