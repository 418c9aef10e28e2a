"""Shell completion, through argcomplete.

In ~/.bashrc: `eval "$(register-python-argcomplete grasp)"`; of zsh and fish too.
"""

import argparse
from collections.abc import Callable, Iterator

from grasp.cli.parser import Parser

ASKED = "_ARGCOMPLETE"  # the variable by which a shell asks
# what an argument names, of config/<kind>
NAMED = {
    "object": "objects", "objects": "objects", "detector": "detectors", "rig": "rigs",
    "profile": "profiles", "surface": "surfaces", "campaign": "campaigns",
}  # fmt: skip


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

        from detector.plugins import offered
        from grasp.settings import names

        endings = ("toml", "py", "onnx") if kind == "detectors" else ("toml",)
        files = FilesCompleter(endings)(prefix)
        more = offered() if kind == "detectors" else ()
        return [*names(kind), *more, *files]

    return words
