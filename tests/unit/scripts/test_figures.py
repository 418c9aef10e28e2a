"""Every table and picture of the pages says where it comes from; stale ones are found."""

import shutil
import subprocess
from pathlib import Path

import pytest

from scripts import figures

ROOT = Path(__file__).parents[3]
TABLE = "| a | b |\n|---|---|\n| 1 | 2 |\n"
COMMIT = "0123abc"
ENTRY = f'<!-- figure: id=x command="make bench" commit={COMMIT} code=grasp -->\n'


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty page of a checkout with a folder of code."""
    (tmp_path / "grasp").mkdir()
    monkeypatch.setattr(figures, "HOME", tmp_path)
    return tmp_path / "page.md"


def test_every_table_and_picture_of_the_pages_has_an_entry() -> None:
    assert len([item for page in figures.pages() for item in figures.shown(page)]) > 50


def test_names_of_figures_are_unique() -> None:
    items = [item.figure for page in figures.pages() for item in figures.shown(page)]
    names = [figure.id for figure in items if figure is not None]
    assert len(names) == len(set(names))


def test_commits_of_figures_are_of_this_history() -> None:
    if not (ROOT / ".git").exists() or git(ROOT, "rev-parse", "--is-shallow-repository") == "true":
        pytest.skip("no history here")
    items = [item.figure for page in figures.pages() for item in figures.shown(page)]
    named = {c for figure in items if figure is not None for c in (figure.commit, figure.as_of)}
    for commit in named:
        git(ROOT, "merge-base", "--is-ancestor", commit, "HEAD")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (TABLE, "no entry"),
        ("![picture](x.svg)\n", "no entry"),
        (f"<!-- reference -->\n{TABLE}\n{TABLE}", "no entry"),
        (f"{ENTRY.replace('code=grasp ', '')}{TABLE}", "code"),
        (f"{ENTRY.replace('code=grasp', 'code=grasp,gone.py')}{TABLE}", "gone.py is not there"),
        (f"{ENTRY.replace(COMMIT, 'HEAD')}{TABLE}", "commit"),
        (f"{ENTRY.replace('id=x', 'id=x colour=red')}{TABLE}", "colour"),
    ],
)
def test_a_missing_or_wrong_entry_is_refused(page: Path, text: str, complaint: str) -> None:
    page.write_text(text)
    with pytest.raises(figures.WrongPageError, match=complaint):
        figures.shown(page)


def test_an_entry_may_stand_for_several_tables_and_program_text_needs_none(page: Path) -> None:
    page.write_text(f"{ENTRY.replace(' -->', ' tables=2 -->')}{TABLE}\n{TABLE}```\n{TABLE}```\n")
    (item,) = figures.shown(page)
    assert item.figure is not None
    assert item.figure.command == "make bench"


def test_marks_come_and_go_and_nothing_else_changes(page: Path) -> None:
    text = f"# Page\n\n<!-- reference: why -->\n{TABLE}\nprose\n\n{ENTRY}{TABLE}"
    page.write_text(text)

    def mark_of(figure: figures.Figure | None) -> str | None:
        return None if figure is None else figures.MARK.format(figure.command)

    for _ in range(2):
        page.write_text(figures.marked(page, mark_of))
        assert page.read_text().count("*(stale:") == 1
        assert [item.mark is not None for item in figures.shown(page)] == [False, True]
    assert figures.marked(page, lambda figure: None) == text


def test_taking_off_a_mark_that_touches_its_table_takes_no_row(page: Path) -> None:
    mark = figures.MARK.format("make bench")
    page.write_text(f"{ENTRY.rstrip()}\n{mark}\n{TABLE}")
    assert TABLE in figures.marked(page, lambda figure: None)


def git(folder: Path, *command: str) -> str:
    name = ("-c", "user.name=x", "-c", "user.email=x@localhost", "-c", "commit.gpgsign=false")
    done = subprocess.run(
        ("git", *name, *command), cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_a_commit_that_is_not_there_is_told_and_no_traceback(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    git(page.parent, "init", "-q")
    page.write_text(f"{ENTRY}{TABLE}")
    monkeypatch.setattr(figures, "pages", lambda: [page])
    figures._blobs.cache_clear()
    for option in ("--check", "--mark"):
        monkeypatch.setattr("sys.argv", ["figures.py", option])
        assert figures.main() == 1
        assert f"no commit {COMMIT}" in capsys.readouterr().err
    assert page.read_text() == f"{ENTRY}{TABLE}"


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_settings_that_change_their_names_make_a_figure_stale_and_folders_do_not(
    page: Path,
) -> None:
    folder = page.parent

    def commit() -> str:
        git(folder, "add", "-A")
        git(folder, "commit", "-q", "-m", "x")
        figures._blobs.cache_clear()
        return git(folder, "rev-parse", "HEAD")

    def stale(as_of: str) -> list[str]:
        return figures.changes(figures.Figure("x", "make", as_of, "room"))

    git(folder, "init", "-q")
    (folder / "room").mkdir()
    (folder / "room" / "ball.toml").write_text("mass_kg = 1\n")
    (folder / "room" / "can.toml").write_text("mass_kg = 2\n")
    first = commit()
    (folder / "room" / "objects").mkdir()
    (folder / "room" / "can.toml").rename(folder / "room" / "objects" / "can.toml")
    moved = commit()
    assert stale(first) == []
    (folder / "room" / "ball.toml").write_text("mass_kg = 2\n")
    (folder / "room" / "objects" / "can.toml").write_text("mass_kg = 1\n")
    commit()
    assert stale(moved) == ["room/ball.toml", "room/objects/can.toml"]


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_stale_is_what_computes_something_else_and_not_what_moved(page: Path) -> None:
    folder = page.parent

    def commit(name: str, text: str) -> str:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
        git(folder, "add", "-A")
        git(folder, "commit", "-q", "-m", name)
        figures._blobs.cache_clear()
        return git(folder, "rev-parse", "HEAD")

    def stale(as_of: str, code: str = "room,-room/cli") -> list[str]:
        return figures.changes(figures.Figure("x", "make", as_of, code))

    git(folder, "init", "-q")
    first = commit("old/a.py", '"""Text."""\nimport b\n\n\ndef f():\n    return b.x  # why\n')
    git(folder, "rm", "-q", "old/a.py")
    moved = commit("room/c.py", '"""Other."""\nfrom room import b\n\n\ndef f():\n    return b.x\n')
    assert stale(first) == []
    changed = commit("room/c.py", "from room import b\n\n\ndef f():\n    return b.x + 1\n")
    assert stale(moved) == stale(first) == ["room/c.py"]
    commit("room/cli/verb.py", "print('left out')\n")
    assert stale(changed) == []
    added = commit("room/data.toml", "a = 1\n")
    assert stale(changed) == ["room/data.toml"]
    git(folder, "rm", "-q", "room/data.toml")
    commit("page.md", "text")
    assert stale(added) == ["room/data.toml"]
