"""The parser of every verb: errors reported as all others are, help in groups, examples."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

from drivers.errors import UsageError

# what an option is about, where it is not about the verb's own matter
ABOUT = {
    "rig and settings": ("--rig", "--profile", "--detector", "--config", "--set",
                         "--confirm-motion", "--seed"),
    "what is shown and kept": ("--runs", "--out", "--resume", "--report", "--view", "--pace",
                               "--json", "--verbose"),
    "who works": ("--jobs", "--cluster"),
}  # fmt: skip
TITLES = {option: title for title, options in ABOUT.items() for option in options}
EXAMPLES = "examples:\n"  # an epilog that begins so keeps its lines


class Formatter(argparse.HelpFormatter):
    """Wraps all but examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLES) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Raises usage errors, so that they are reported as every other error is; the parser of a verb
    those of its own options, so that the help it names is the verb's."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self._titled: dict[str, Any] = {}
        self._why_not: dict[str, str] = {}
        super().__init__(*args, **{"formatter_class": Formatter, **given})

    def add_argument(self, *args: Any, **given: Any) -> argparse.Action:
        """In the group of options that it belongs to."""
        title = next((TITLES[word] for word in args if word in TITLES), None)
        if title is None:
            return super().add_argument(*args, **given)
        if title not in self._titled:
            self._titled[title] = self.add_argument_group(title)
        action: argparse.Action = self._titled[title].add_argument(*args, **given)
        return action

    def flag(self, name: str, text: str) -> None:
        """An option without a value."""
        self.add_argument(name, action="store_true", help=text)

    def option(
        self, names: str, text: str, reads: Callable[[str], Any] | None = None, **given: Any
    ) -> None:
        """``names``: its own and what its value is called, as `--seed N` or `file FILE`. The help
        ends with the default where it says nothing of one."""
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

    def refuse(self, *options: str, because: str) -> None:
        """Say why it does not take what other verbs take."""
        self._why_not |= dict.fromkeys(options, because)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            reasons = [self._why_not.get(word.partition("=")[0]) for word in unknown]
            why = next((f": {reason}" for reason in reasons if reason), "")
            self.error(f"`{self.prog}` does not take {' '.join(unknown)}{why}")
        for action in self._actions:
            if action.nargs in ("+", "*"):
                self._check_once(action, getattr(namespace, action.dest, None) or ())
        return namespace, unknown

    def _check_once(self, action: argparse.Action, values: Sequence[object]) -> None:
        """What is listed twice would be counted twice."""
        for value in dict.fromkeys(values):
            if values.count(value) > 1:
                name = "/".join(action.option_strings) or action.metavar or action.dest
                self.error(f"argument {name}: {value} twice")

    def error(self, message: str) -> NoReturn:
        raise UsageError(message, f"see `{self.prog} --help`")

    def arguments(self) -> list[argparse.Action]:
        """All that it takes, but verbs."""
        return [a for a in self._actions if not isinstance(a, argparse._SubParsersAction)]  # noqa: SLF001

    def verbs(self) -> dict[str, "Parser"]:
        """Its own verbs by name; none where it is a verb itself."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001  (no public way)
                return dict(action.choices)
        return {}

    def listed(self) -> list[argparse.Action]:
        """Its verbs as the help lists them."""
        every = [a for a in self._actions if isinstance(a, argparse._SubParsersAction)]  # noqa: SLF001
        return [verb for action in every for verb in action._choices_actions]  # noqa: SLF001


class RootParser(Parser):
    """Lists its verbs by what they are for."""

    def __init__(self, *args: Any, groups: Mapping[str, Sequence[str]], **given: Any) -> None:
        self._groups = groups
        super().__init__(*args, **given)

    def format_help(self) -> str:
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        told = {verb.dest: verb for verb in self.listed()}
        for title, names in self._groups.items():
            formatter.start_section(title)
            formatter.add_arguments([told[name] for name in names])
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()


def group(
    verbs: Any, name: str, text: str, metavar: str = "ACTION", dest: str = argparse.SUPPRESS
) -> Any:
    """A verb that has verbs of its own: where they are added."""
    parser = verbs.add_parser(name, help=text, description=text)
    return parser.add_subparsers(dest=dest, metavar=metavar, required=True)


def verb(verbs: Any, name: str, does: Callable[..., int], text: str, more: str = "") -> Parser:
    """A verb that does something. ``more``: what its own help says after the line of the list."""
    parser: Parser = verbs.add_parser(name, help=text, description=text + more)
    parser.set_defaults(handler=does)
    return parser
