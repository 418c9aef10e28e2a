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


CALL_WORK = 20  # of any built-in function; those that need more look at the clock themselves
_ASSIGN_WORK = 10  # a list is copied and measured


class Weigher:
    """How much work a piece of a program is when each part of it is run once: about a microsecond
    for a value, an operator or a statement."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}  # by identity: the tree outlives its weigher

    def work(self, *pieces: Statement | Expression) -> int:
        return sum(map(self._of, pieces))

    def _of(self, piece: Statement | Expression) -> int:
        if id(piece) not in self._known:
            own = {Call: CALL_WORK, Assign: _ASSIGN_WORK}.get(type(piece), 1)
            self._known[id(piece)] = own + self.work(*_parts(piece))
        return self._known[id(piece)]


def _parts(piece: Statement | Expression) -> Iterator[Statement | Expression]:
    """What is run with it; a definition is not."""
    match piece:
        case Sequence(items, _):
            yield from items
        case Index(base, at):
            yield from (base, at)
        case Call(_, positional, named):
            yield from positional
            yield from (value for _, value in named)
        case Binary(_, left, right):
            yield from (left, right)
        case Unary(_, value) | Evaluate(value) | Kill(value):
            yield value
        case Assign(_, value, at, _):
            yield from (value,) if at is None else (value, at)
        case Return(value) if value is not None:
            yield value
        case If(branches, otherwise):
            for condition, body in branches:
                yield from (condition, *body)
            yield from otherwise
        case While(condition, body):
            yield from (condition, *body)
