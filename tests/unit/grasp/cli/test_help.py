"""Help in sections, valid examples, and shell completion."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from grasp.cli.commands import build_parser
from grasp.cli.main import main, module_of
from grasp.cli.parser import EXAMPLES
from grasp.settings import names

ROOT = Path(__file__).parents[4]


def helped(*words: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main([*words, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_every_example_is_a_command_of_this_program() -> None:
    shown = [leaf.epilog for leaf in build_parser().leaves() if leaf.epilog]
    lines = [line for text in shown for line in text.removeprefix(EXAMPLES).splitlines()]
    assert len(lines) > 30
    for line in lines:
        first, *words = shlex.split(line)
        assert first == "grasp"
        assert build_parser().parse_args(words).command, line


def test_every_command_has_its_function() -> None:
    names = [leaf.get_default("command") for leaf in build_parser().leaves()]
    assert len(names) == 33
    for name in names:
        assert callable(getattr(module_of(name), name.replace(" ", "_")))


def test_every_command_is_in_one_section_of_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    text = helped(capsys=capsys)
    for section in ("try", "measure", "real devices", "settings"):
        assert f"\n{section}:\n" in text
    for name in build_parser().commands():
        assert text.count(f"\n  {name} ") == 1
    assert len(text.splitlines()) < 45


# Completion


def completed(line: str, folder: Path) -> list[str]:
    """Completions that a shell gets at the end of a line."""
    out = folder / "out"
    program = "import sys; from grasp.cli.main import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=folder, check=False, timeout=60,
        capture_output=True, text=True,
        env={
            **os.environ, "PYTHONPATH": str(ROOT), "_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n",
            "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9",
            "_ARGCOMPLETE_STDOUT_FILENAME": str(out), "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
        },
    )  # fmt: skip
    assert done.stderr == ""
    return out.read_text().split("\n")


def test_a_shell_completes_commands_and_options(tmp_path: Path) -> None:
    assert completed("grasp cam", tmp_path) == ["campaign"]
    assert {"lift", "tap", "acquire"} <= set(completed("grasp run ", tmp_path))
    assert "--confirm-motion" in completed("grasp run lift --con", tmp_path)


def test_a_shell_completes_names_and_user_files(tmp_path: Path) -> None:
    (tmp_path / "mine.py").touch()
    (tmp_path / "mug.toml").touch()
    (tmp_path / "notes.txt").touch()
    objects = completed("grasp run lift --object ", tmp_path)
    assert set(objects) == {*names("objects"), "mug.toml"}
    assert completed("grasp run lift --object ca", tmp_path) == ["can", "cardboard"]
    detectors = completed("grasp run lift --detector ", tmp_path)
    assert {"tcn", "mine.py"} <= set(detectors)
    assert "paper" in completed("grasp campaign run ", tmp_path)
