"""Argument parser of every command, with grouped help, examples and shell completion. Its errors
are reported like all others. ``Options`` are the values that it reads, as a typed class."""

import argparse
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from types import NoneType
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    NoReturn,
    Self,
    dataclass_transform,
    get_args,
    get_origin,
)

from drivers.errors import UsageError

# headings in the help for options that are not specific to a command
HEADINGS = {
    "rig and settings": ("--rig", "--profile", "--detector", "--config", "--set",
                         "--confirm-motion", "--seed"),
    "what is shown and kept": ("--runs", "--out", "--resume", "--report", "--view", "--pace",
                               "--json"),
    "workers": ("--jobs", "--cluster"),
}  # fmt: skip
HEADING_OF = {option: heading for heading, options in HEADINGS.items() for option in options}
EXAMPLES = "examples:\n"  # an epilog that begins with this keeps its lines
COMPLETING = "_ARGCOMPLETE"  # environment variable with which a shell requests completions
# arguments that name a file of config/<kind>
CONFIG_KINDS = {
    "object": "objects", "objects": "objects", "detector": "detectors", "rig": "rigs",
    "profile": "profiles", "surface": "surfaces", "campaign": "campaigns",
}  # fmt: skip


class Formatter(argparse.HelpFormatter):
    """Wraps all but examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLES) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Raises usage errors, also for unknown and shortened options."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self._headed: dict[str, argparse._ArgumentGroup] = {}
        self._commands: argparse._SubParsersAction[Parser] | None = None
        self._sections: dict[str, list[argparse.Action]] = {}
        super().__init__(*args, **{"formatter_class": Formatter, "allow_abbrev": False, **options})
        self._negative_number_matcher = re.compile(r"-[0-9.]+([eE][+-]?[0-9]+)?$")

    def add_argument(self, *args: Any, **options: Any) -> argparse.Action:
        """Add an argument, under its heading."""
        heading = next((HEADING_OF[word] for word in args if word in HEADING_OF), None)
        if heading is None:
            return super().add_argument(*args, **options)
        if heading not in self._headed:
            self._headed[heading] = self.add_argument_group(heading)
        return self._headed[heading].add_argument(*args, **options)

    def alternatives(self, word: str) -> argparse._ArgumentGroup:
        """The group of ``How.either``."""
        if word not in self._headed:
            self._headed[word] = self.add_mutually_exclusive_group(required=word.endswith("!"))
        return self._headed[word]

    def command(
        self, name: str, text: str, section: str = "", more: str = "", examples: Sequence[str] = ()
    ) -> "Parser":
        """Add a command. ``text``: its line in lists; ``more``: further text in its help."""
        if self._commands is None:
            self._commands = self.add_subparsers(
                metavar="COMMAND", required=True, parser_class=Parser
            )
        if section:
            self._sections.setdefault(section, []).append(argparse.Action([], name, help=text))
        parser = self._commands.add_parser(name, help=text, description=text + more)
        if examples:
            parser.epilog = EXAMPLES + "\n".join(f"  {line}" for line in examples)
        parser.set_defaults(command=parser.prog.partition(" ")[2])
        return parser

    def format_help(self) -> str:
        """Help with the commands in sections, if there are any."""
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
            from grasp.settings import suggestion

            known = [word for action in self._actions for word in action.option_strings]
            hint = suggestion(unknown[0].partition("=")[0], known)
            self.error(f"`{self.prog}` does not take {' '.join(unknown)}{hint}")
        return namespace, unknown

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        if "" in arg_strings and action.nargs not in (argparse.PARSER, argparse.REMAINDER):
            raise argparse.ArgumentError(action, "the value is empty")
        return super()._get_values(action, arg_strings)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            from grasp.settings import suggestion

            error.message += suggestion(str(value), list(map(str, action.choices or ())))
            raise

    def error(self, message: str) -> NoReturn:
        raise UsageError(message, f"see `{self.prog} --help`")

    def commands(self) -> "dict[str, Parser]":
        """Subcommands by name."""
        return {} if self._commands is None else dict(self._commands.choices)

    def arguments(self) -> list[argparse.Action]:
        """Options and positional arguments."""
        return [action for action in self._actions if action is not self._commands]

    def leaves(self) -> "Iterator[Parser]":
        """All commands below this one that have no subcommands."""
        for parser in self.commands().values():
            yield from parser.leaves()
        if self._commands is None:
            yield self


def complete(parser: Parser) -> None:
    """Print completions for a shell, and end the process. In ~/.bashrc: `eval
    "$(register-python-argcomplete grasp)"`."""
    import argcomplete

    for leaf in parser.leaves():
        for action in leaf.arguments():
            if action.dest in CONFIG_KINDS and action.choices is None:
                completer = partial(_names_and_files, CONFIG_KINDS[action.dest])
                action.completer = completer  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def _names_and_files(kind: str, prefix: str, **_: object) -> list[str]:
    """Names of config/<kind>, and the user's files."""
    from argcomplete.completers import FilesCompleter

    from grasp.settings import names

    suffixes = ("toml", "py", "onnx") if kind == "detectors" else ("toml",)
    return [*names(kind), *FilesCompleter(suffixes)(prefix)]


class How(NamedTuple):
    """How a field of ``Options`` is given where it is no usual option. ``either``: at most one of
    the options with this word may be given, and one must be if it ends with `!`."""

    positional: bool = False
    repeated: bool = False  # the option may be given several times
    rest: bool = False  # it takes all words that follow
    either: str = ""


ARGUMENT, SOURCE = How(positional=True), How(either="source!")


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Options:
    """The options of a command. A field is `name: Annotated[type, *marks] = default`; one without a
    default is required. The marks are the name of its value, its help, a parser of the value, and
    ``How``; each but the help may be omitted. The choices of a `Literal` are those of the option.

    Not a `dataclass`: to make forty of these takes 70 ms, at every start."""

    commands: ClassVar[dict[str, type["Options"]]] = {}  # by name
    about: ClassVar[str] = ""  # in lists of commands
    more: ClassVar[str] = ""  # in its help
    examples: ClassVar[Sequence[str]] = ()
    section: ClassVar[str] = ""

    def __init_subclass__(
        cls, command: str = "", about: str = "", more: str = "", examples: Sequence[str] = (),
        section: str = "",
    ) -> None:  # fmt: skip
        if command:
            cls.about, cls.more, cls.examples, cls.section = about, more, examples, section
            Options.commands[command] = cls

    def __init__(self, **given: object) -> None:
        vars(self).update(given)

    @classmethod
    def of(cls, parsed: argparse.Namespace) -> Self:
        """What a parser with these options has read."""
        return cls(**{name: getattr(parsed, name) for name in cls._fields()})

    @classmethod
    def _fields(cls) -> dict[str, object]:
        """Types of the fields by name: of the class itself, then of its bases."""
        found: dict[str, object] = {}
        for kind in cls.__mro__:
            for name, annotation in vars(kind).get("__annotations__", {}).items():
                if get_origin(annotation) is Annotated:
                    found.setdefault(name, annotation)
        return found

    @classmethod
    def add_to(cls, parser: Parser) -> None:
        """Add these options to a parser. The help of one ends with its default, unless its text
        mentions one."""
        for name, annotation in cls._fields().items():
            kind, *marks = get_args(annotation)
            *metavar, text = (mark for mark in marks if isinstance(mark, str))
            how = next((mark for mark in marks if isinstance(mark, How)), How())
            word = name if how.positional else f"--{name.replace('_', '-')}"
            if kind is bool:
                parser.add_argument(word, action="store_true", help=text)
                continue
            value, many, choices = _parts(kind)
            default, required = getattr(cls, name, None), not hasattr(cls, name)
            if "default" not in text and default not in (None, "", ()):
                text += f" (default: {f'{default:g}' if isinstance(default, float) else default})"
            if isinstance(default, Path):  # as text, it is checked like a given one
                default = str(default)
            by_type = Path if value is Path else str
            more: dict[str, Any] = {"nargs": "+"} if many else {}
            if how.repeated:
                more = {"action": "append"}
            elif how.rest:
                more = {"nargs": argparse.REMAINDER}
            elif how.positional and not required:
                more["nargs"] = "*" if many else "?"
            elif required and not how.positional:
                more["required"] = True
            adds = parser.alternatives(how.either) if how.either else parser
            adds.add_argument(
                word, help=text, metavar=next(iter(metavar), None), choices=choices or None,
                type=next((mark for mark in marks if callable(mark)), by_type),
                default=list(default) if isinstance(default, tuple) else default, **more,
            )  # fmt: skip


def _parts(kind: object) -> tuple[object, bool, tuple[str, ...]]:
    """Type of one value, whether there may be several, and the choices."""
    if NoneType in get_args(kind):
        (kind,) = (part for part in get_args(kind) if part is not NoneType)
    if get_origin(kind) is Sequence:
        return get_args(kind)[0], True, ()
    return kind, False, get_args(kind)
