"""`grasp completion`: words that a shell can offer, by argcomplete."""

import argparse
from collections.abc import Callable, Iterator
from typing import Any

from grasp.cli import exits
from grasp.cli.parser import Parser

HELP = "print what makes a shell complete the words of `grasp`"
ASKED = "_ARGCOMPLETE"  # the variable by which a shell asks
# what an argument names, of config/<kind>
NAMED = {
    "object": "objects", "objects": "objects", "detector": "detectors", "rig": "rigs",
    "profile": "profiles", "surface": "surfaces", "campaign": "campaigns",
}  # fmt: skip


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "completion", help=HELP,
        description=HELP + ". In ~/.bashrc or ~/.zshrc: eval \"$(grasp completion bash)\", or zsh.",
    )  # fmt: skip
    parser.add_argument("shell", choices=("bash", "zsh", "fish"))
    parser.set_defaults(handler=show)


def show(args: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    print(shellcode(["grasp"], shell=args.shell))
    return exits.SUCCESS


def complete(parser: Parser) -> None:
    """Answer a shell, and end the process."""
    import argcomplete

    for action in _arguments(parser):
        kind = NAMED.get(action.dest)
        if kind is not None and action.choices is None:
            action.completer = _names_of(kind)  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def _arguments(parser: Parser) -> Iterator[argparse.Action]:
    yield from parser.arguments()
    for verb in parser.verbs().values():
        yield from _arguments(verb)


def _names_of(kind: str) -> Callable[..., list[str]]:
    """Names of config/<kind>, and the files that one of one's own may lie in."""

    def words(prefix: str, **_: object) -> list[str]:
        from argcomplete.completers import FilesCompleter

        from detector.own import offered
        from grasp.settings import names

        endings = ("toml", "py", "onnx") if kind == "detectors" else ("toml",)
        files = FilesCompleter(endings)(prefix)
        more = offered() if kind == "detectors" else ()
        return [*names(kind), *more, *files]

    return words
