"""Syntax tree of URScript: what `urscript.parse` gives and `urscript.compile` takes."""

from collections.abc import Iterator

from msgspec import Struct


class Literal(Struct, frozen=True):
    """A number, a truth value or a string."""

    value: int | float | bool | str


class Name(Struct, frozen=True):
    """A variable."""

    name: str


class Sequence(Struct, frozen=True):
    """``[a, b]`` or ``p[x, y, z, rx, ry, rz]``."""

    items: tuple["Expression", ...]
    pose: bool


class Index(Struct, frozen=True):
    """``base[at]``."""

    base: "Expression"
    at: "Expression"


class Call(Struct, frozen=True):
    """``name(positional, key=named)``."""

    name: str
    positional: tuple["Expression", ...]
    named: tuple[tuple[str, "Expression"], ...]


class Run(Struct, frozen=True):
    """``run name()``: start a thread; its value is the handle."""

    name: str


class Unary(Struct, frozen=True):
    """``-x`` or ``not x``."""

    operator: str
    operand: "Expression"


class Binary(Struct, frozen=True):
    """``left operator right``."""

    operator: str
    left: "Expression"
    right: "Expression"


Expression = Literal | Name | Sequence | Index | Call | Run | Unary | Binary


class Assign(Struct, frozen=True):
    """``target = value``, ``global target = value``; with ``at``, one element of a list."""

    target: str
    value: Expression
    at: Expression | None = None
    scope: str = ""


class Evaluate(Struct, frozen=True):
    """An expression for its effect."""

    value: Expression


class If(Struct, frozen=True):
    """Branches in order, each a condition and a body; ``otherwise`` may be empty."""

    branches: tuple[tuple[Expression, "Body"], ...]
    otherwise: "Body"


class While(Struct, frozen=True):
    """A loop."""

    condition: Expression
    body: "Body"


class Return(Struct, frozen=True):
    """End of a function, with or without a value."""

    value: Expression | None


class Kill(Struct, frozen=True):
    """End of the thread with this handle."""

    handle: Expression


class Plain(Struct, frozen=True):
    """``break``, ``continue``, ``halt``, ``enter_critical`` or ``exit_critical``."""

    word: str


class Function(Struct, frozen=True):
    """A definition; defining is a statement, and what is defined is known everywhere."""

    name: str
    parameters: tuple[str, ...]
    body: "Body"
    thread: bool


Statement = Assign | Evaluate | If | While | Return | Kill | Plain | Function
Body = tuple[Statement, ...]


def inside(body: Body) -> Iterator[Statement]:
    """All statements, those of inner blocks and functions too."""
    for statement in body:
        yield statement
        if isinstance(statement, Function | While):
            yield from inside(statement.body)
        elif isinstance(statement, If):
            for _, inner in statement.branches:
                yield from inside(inner)
            yield from inside(statement.otherwise)
