"""Where every table and picture of the pages comes from, and whether it is older than its code.

    python scripts/figures.py            list them
    python scripts/figures.py --mark     write into the pages which are stale, take off other marks
    python scripts/figures.py --check    exit 1 if a table has no entry or a mark is wrong

Above each table and picture stands an entry, a comment on a line of its own: `<!-- reference -->`
where nothing is measured, with a reason or without (`<!-- reference: held by a test -->`), or

    <!-- figure: id=NAME command="..." detector=gru commit=54ea1fc code=scenarios/tap,detector -->

with the command that makes it, the commit it was made at and the files and folders that it rests
on. `confirmed=COMMIT` names a later commit, up to which the code was shown to give the same;
`tables=3` says that one entry stands for three in a row; `-PATH` leaves a part of the code out. A
figure is stale if a file of its code was not there, in whatever folder, or was there and is gone.
Of Python counts what it computes: imports, comments and docstrings do not, nor does the file's
name. Settings and weights are chosen by theirs, so it counts.
"""

import argparse
import ast
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

HOME = Path(__file__).resolve().parent.parent
ENTRY = re.compile(r"<!-- (figure|reference)(?:: (.*))? -->$")
MARK = "*(stale: older than the code it rests on; `{}`)*"
MARKED = re.compile(r"\*\(stale: .*\)\*$")
RULE = re.compile(r"\|[ :|-]+\|$")

# what a trial on any rig rests on, and what of it one in virtual time does not run
TRIAL = (
    *("grasp", "-grasp/cli", "detector", "-detector/training", "drivers"),
    *("scenarios/rigs", "scenarios/trial", "scenarios/world"),
    *("config/objects", "-config/objects/unseen", "config/detectors", "config/profiles"),
    *("config/rigs", "config/calibrations"),
)
WIRES = (
    *("drivers/robotiq/emulator", "drivers/takktile/emulator", "drivers/ur/emulator"),
    *("drivers/fairness.py", "drivers/robotiq/words.py", "drivers/takktile/identify.py"),
    *("drivers/ur/link", "scenarios/rigs/emulated_cell.py", "scenarios/rigs/cell_control.py"),
    *("scenarios/rigs/device_checks.py", "scenarios/rigs/doctor.py", "scenarios/rigs/release.py"),
)

# what many figures rest on
SETS = {
    "@trial": (*TRIAL, *(f"-{path}" for path in WIRES)),
    "@wired": TRIAL,  # one whose devices are asked over their wires
    "@scores": (
        *("detector", "-detector/training", "scenarios/acquire", "scenarios/world"),
        *("drivers/takktile/model", "config/datasets", "config/bodies", "config/detectors"),
    ),
    "@contact": (
        *("scenarios/world/contact.py", "scenarios/world/laws.py"),
        *("scenarios/world/contact_settings.py", "scenarios/world/objects.py"),
    ),
}
Blobs = dict[str, str]  # the path of a file, by its contents and what else tells it from others
Commit = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{7,40}$")]


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an entry says."""

    id: str
    command: str
    commit: Commit
    code: str  # files, folders and names of SETS with commas between; -PATH is left out of them
    detector: str = "none"
    confirmed: Commit | None = None
    tables: Annotated[int, msgspec.Meta(ge=1)] = 1

    @property
    def as_of(self) -> str:
        """The last commit whose code is known to give this figure."""
        return self.confirmed or self.commit

    @property
    def paths(self) -> list[str]:
        """Of the code, relative to the checkout."""
        named = (SETS.get(part, (part,)) for part in self.code.split(","))
        return [path for paths in named for path in paths]

    def rests_on(self, name: str) -> bool:
        """Whether a file is of its code."""
        found = [path for path in self.paths if f"{name}/".startswith(f"{path.lstrip('-')}/")]
        return bool(found) and not any(path.startswith("-") for path in found)


class Shown(msgspec.Struct, frozen=True):
    """A table or picture of a page; ``figure`` is none where nothing is measured."""

    page: Path
    line: int  # of the entry, from 0
    figure: Figure | None
    mark: str | None

    @property
    def place(self) -> str:
        """As an editor takes it."""
        return f"{self.page.relative_to(HOME)}:{self.line + 1}"


class WrongPageError(ValueError):
    """A table without an entry, or an entry that does not say what it must."""


def pages() -> list[Path]:
    """Every page that may show a figure."""
    return [HOME / "README.md", *sorted((HOME / "docs").glob("*.md"))]


def shown(page: Path) -> list[Shown]:
    """Tables and pictures of a page with their entries, in order."""
    lines = page.read_text(encoding="utf-8").splitlines()
    found: list[Shown] = []
    covered = 0
    for start in _starts(lines):
        if covered:
            covered -= 1
            continue
        found.append(_shown(page, lines, start))
        figure = found[-1].figure
        covered = figure.tables - 1 if figure else 0
    return found


def _starts(lines: list[str]) -> Iterator[int]:
    """First lines of tables and pictures, those of program text left out."""
    fenced = False
    for number, line in enumerate(lines):
        fenced ^= line.startswith("```")
        table = line.startswith("|") and RULE.match("".join(lines[number + 1 : number + 2]))
        if not fenced and (table or line.startswith("![")):
            yield number


def _shown(page: Path, lines: list[str], start: int) -> Shown:
    above = [n for n in range(start - 1, max(start - 5, -1), -1) if lines[n].strip()]
    mark = None
    if above and MARKED.match(lines[above[0]]):
        mark = lines[above.pop(0)]
    entry = ENTRY.match(lines[above[0]]) if above else None
    if entry is None:
        raise WrongPageError(f"{page.name}:{start + 1}: no entry above this table or picture")
    return Shown(page, above[0], _figure(f"{page.name}:{above[0] + 1}", *entry.groups()), mark)


def _figure(place: str, kind: str, text: str | None) -> Figure | None:
    if kind == "reference":
        return None
    fields = dict(word.partition("=")[::2] for word in shlex.split(text or ""))
    try:
        figure = msgspec.convert(fields, Figure, strict=False)
    except msgspec.ValidationError as error:
        raise WrongPageError(f"{place}: {error}") from None
    gone = [path for path in figure.paths if not (HOME / path.lstrip("-")).exists()]
    if gone:
        raise WrongPageError(f"{place}: {', '.join(gone)} is not there")
    return figure


def changes(figure: Figure) -> list[str]:
    """Files of its code that came or went since the figure was last known to be right."""
    before, now = _blobs(figure.as_of), _blobs("HEAD")
    return sorted({*_unknown(before, now, figure), *_unknown(now, before, figure)})


def _unknown(there: Blobs, here: Blobs, figure: Figure) -> list[str]:
    """What the figure rests on here and that is not there, under any name."""
    unknown = {blob: name for blob, name in here.items() if blob not in there}
    unknown = {blob: name for blob, name in unknown.items() if figure.rests_on(name)}
    if not unknown:
        return []
    known = {_essence(blob, name) for blob, name in there.items() if blob not in here}
    return [name for blob, name in unknown.items() if _essence(blob, name) not in known]


@cache
def _blobs(commit: str) -> Blobs:
    """All files of a commit but texts, which nothing is computed from."""
    try:
        tree = _git("ls-tree", "-r", "--full-tree", commit)
    except subprocess.CalledProcessError:
        raise WrongPageError(f"there is no commit {commit} in this history") from None
    entries = (line.split("\t") for line in tree.splitlines())
    files = ((what.split()[2], path) for what, path in entries if not path.endswith(".md"))
    return {_identity(blob, path): path for blob, path in files}


def _identity(blob: str, path: str) -> str:
    """What a file has to have in common with another to be the same."""
    return blob if path.endswith(".py") else f"{blob} {Path(path).name}"


@cache
def _essence(identity: str, name: str) -> str:
    """What a file computes: of Python all but imports, comments and docstrings."""
    if not name.endswith(".py"):
        return identity
    return ast.dump(_Bare().visit(ast.parse(_git("cat-file", "blob", identity))))


class _Bare(ast.NodeTransformer):
    """Drops what a move changes, and what only people read."""

    def visit_Import(self, node: ast.Import) -> None:
        """Drop it."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """Drop it."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        """Drop a docstring."""
        return None if isinstance(node.value, ast.Constant) else node


def _git(*command: str) -> str:
    done = subprocess.run(("git", *command), cwd=HOME, check=True, stdout=subprocess.PIPE)
    return done.stdout.decode()


def mark_for(figure: Figure | None) -> str | None:
    """The mark that belongs above it."""
    return MARK.format(figure.command) if figure is not None and changes(figure) else None


def marked(page: Path, mark_of: Callable[[Figure | None], str | None]) -> str:
    """The page's text with exactly the marks that belong there."""
    lines = page.read_text(encoding="utf-8").splitlines()
    for item in reversed(shown(page)):
        if item.mark:
            place = lines.index(item.mark, item.line)
            blank = lines[place + 1 : place + 2] == [""]
            del lines[place : place + 1 + blank]
        if mark := mark_of(item.figure):
            lines[item.line + 1 : item.line + 1] = [mark, ""]
    return "\n".join(lines) + "\n"


def _print(item: Shown) -> None:
    if (figure := item.figure) is None:
        print(f"{item.place}  reference")
        return
    confirmed = f", confirmed at {figure.confirmed}" if figure.confirmed else ""
    print(f"{item.place}  {figure.id}: detector {figure.detector}, made at {figure.commit}", end="")
    print(f"{confirmed}\n    {figure.command}")
    if changed := changes(figure):
        more = f" and {len(changed) - 3} more" if len(changed) > 3 else ""
        print(f"    STALE: {', '.join(changed[:3])}{more}")


def main() -> int:
    """List, mark or check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--mark", action="store_true", help="write the marks into the pages")
    what.add_argument("--check", action="store_true", help="exit 1 if a mark is wrong")
    asked = parser.parse_args()
    try:
        return _done(asked)
    except WrongPageError as error:
        print(error, file=sys.stderr)
        return 1


def _done(asked: argparse.Namespace) -> int:
    items = [item for page in pages() for item in shown(page)]
    if asked.mark:
        for page in pages():
            page.write_text(marked(page, mark_for), encoding="utf-8")
        return 0
    wrong = [item for item in items if item.mark != mark_for(item.figure)]
    for item in () if asked.check else items:
        _print(item)
    for item in wrong:
        print(f"{item.place}: {'no longer stale' if item.mark else 'stale, not marked'}; --mark")
    return int(asked.check and bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
