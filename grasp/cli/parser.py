"""Parser of every command: errors reported as all others are, help in groups, examples, and the
words that a shell completes."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NoReturn

from drivers.errors import UsageError

# headings in the help of what is not a command's own matter
HEADINGS = {
    "rig and settings": ("--rig", "--profile", "--detector", "--config", "--set",
                         "--confirm-motion", "--seed"),
    "what is shown and kept": ("--runs", "--out", "--resume", "--report", "--view", "--pace",
                               "--json"),
    "workers": ("--jobs", "--cluster"),
}  # fmt: skip
HEADING_OF = {option: heading for heading, options in HEADINGS.items() for option in options}
EXAMPLES = "examples:\n"  # an epilog that begins so keeps its lines
COMPLETING = "_ARGCOMPLETE"  # the variable by which a shell asks for completions
# arguments that name a file of config/<kind>
NAMED = {
    "object": "objects", "objects": "objects", "detector": "detectors", "rig": "rigs",
    "profile": "profiles", "surface": "surfaces", "campaign": "campaigns",
}  # fmt: skip


class Formatter(argparse.HelpFormatter):
    """Wraps all but examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLES) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Raises usage errors, also for unknown options."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self._headed: dict[str, Any] = {}
        self._commands: Any = None
        self._sections: dict[str, list[argparse.Action]] = {}
        super().__init__(*args, **{"formatter_class": Formatter, **given})

    def add_argument(self, *args: Any, **given: Any) -> argparse.Action:
        """Under the heading that it belongs to."""
        heading = next((HEADING_OF[word] for word in args if word in HEADING_OF), None)
        if heading is None:
            return super().add_argument(*args, **given)
        if heading not in self._headed:
            self._headed[heading] = self.add_argument_group(heading)
        action: argparse.Action = self._headed[heading].add_argument(*args, **given)
        return action

    def flag(self, name: str, text: str) -> None:
        """An option without a value."""
        self.add_argument(name, action="store_true", help=text)

    def option(
        self, names: str, text: str, reads: Callable[[str], Any] | None = None, **given: Any
    ) -> None:
        """``names``: `--seed N` or `file FILE`. The help ends with the default if ``text`` does not
        mention it."""
        *words, last = names.split()
        if not words or last.startswith("-"):
            words.append(last)
        else:
            given["metavar"] = last
        default = given.get("default")
        if "default" not in text and default not in (None, "", [], ()):
            shown = f"{default:g}" if isinstance(default, float) else "%(default)s"
            text = f"{text} (default: {shown})".lstrip()
        if reads is not None:
            given["type"] = reads
        self.add_argument(*words, help=text, **given)

    def command(
        self, name: str, text: str, more: str = "", examples: Sequence[str] = (), section: str = ""
    ) -> "Parser":
        """Add a command. ``text``: its line in lists; ``more``: what its own help adds."""
        if self._commands is None:
            self._commands = self.add_subparsers(
                metavar="COMMAND", required=True, parser_class=Parser
            )
        if section:
            self._sections.setdefault(section, []).append(argparse.Action([], name, help=text))
        parser: Parser = self._commands.add_parser(name, help=text, description=text + more)
        if examples:
            parser.epilog = EXAMPLES + "\n".join(f"  {line}" for line in examples)
        parser.set_defaults(command=parser.prog.partition(" ")[2])
        return parser

    def format_help(self) -> str:
        """With its commands in sections, if they have any."""
        if not self._sections:
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for section, listed in self._sections.items():
            formatter.start_section(section)
            formatter.add_arguments(listed)
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"`{self.prog}` does not take {' '.join(unknown)}")
        return namespace, unknown

    def error(self, message: str) -> NoReturn:
        raise UsageError(message, f"see `{self.prog} --help`")

    def commands(self) -> "dict[str, Parser]":
        """Its commands by name."""
        return {} if self._commands is None else dict(self._commands.choices)

    def arguments(self) -> list[argparse.Action]:
        """Its options and positional arguments."""
        return [action for action in self._actions if action is not self._commands]

    def leaves(self) -> "Iterator[Parser]":
        """All commands below it without commands of their own."""
        for parser in self.commands().values():
            yield from parser.leaves()
        if self._commands is None:
            yield self


def complete(parser: Parser) -> None:
    """Answer a shell, and end the process. In ~/.bashrc: `eval "$(register-python-argcomplete
    grasp)"`."""
    import argcomplete

    for leaf in parser.leaves():
        for action in leaf.arguments():
            if action.dest in NAMED and action.choices is None:
                named = partial(_names_and_files, NAMED[action.dest])
                action.completer = named  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def _names_and_files(kind: str, prefix: str, **_: object) -> list[str]:
    """Names of config/<kind>, and files of the user's own."""
    from argcomplete.completers import FilesCompleter

    from grasp.settings import names

    suffixes = ("toml", "py", "onnx") if kind == "detectors" else ("toml",)
    return [*names(kind), *FilesCompleter(suffixes)(prefix)]
