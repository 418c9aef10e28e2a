"""URScript as text: tokens and syntax tree (Universal Robots, "The URScript Programming Language").

The part of the language that programs sent to port 30003 use: functions, threads, ``if``,
``while``, assignments, lists, poses, calls with named arguments. Line ends separate nothing but
comments, ``return`` values and calls, as on the controller. Nothing of the text is ever run as
Python: the tree is all that comes out of here.
"""

import re
from collections.abc import Callable

from msgspec import Struct

from drivers.ur.emulator.urscript.syntax import (
    Assign,
    Binary,
    Body,
    Call,
    Evaluate,
    Expression,
    Function,
    If,
    Index,
    Kill,
    Literal,
    Name,
    Plain,
    Return,
    Run,
    Sequence,
    Statement,
    Unary,
    While,
)

MAX_CHARS = 250_000
MAX_NESTING = 40
MAX_TOKENS = 500  # of one chain of operators or indices
_MAX_DIGITS = 40
_INT_END = 2**31


class ScriptError(Exception):
    """The program cannot be compiled, or failed while it ran; the controller ends it."""


class Token(Struct, frozen=True):
    """``kind`` is "number", "text", "name", the word itself for keywords and signs, or "end of"."""

    kind: str
    text: str
    line: int


_PLAIN = frozenset(("break", "continue", "halt", "enter_critical", "exit_critical"))
_WORDS = """
    and def elif else end False global if kill local not or return run sec thread True while xor
"""
_KEYWORDS = _PLAIN | frozenset(_WORDS.split())
_TOKEN = re.compile(
    r"(?P<space>[ \t\r\f]+|#[^\n]*)"
    r"|(?P<line>\n)"
    r"|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r'|(?P<text>"[^"\n]*")'
    r"|(?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:])",
    re.ASCII,
)
_GOES_ON = re.compile(r"[\w.]", re.ASCII)  # what no number is followed by at once
_BLOCKS = re.compile(  # what opens or ends one; other words, strings and comments are skipped
    r'#[^\n]*|"[^"\n]*"|(def|sec|thread|if|while|end)\b|[A-Za-z_]\w*', re.ASCII
)
_SECONDARY = re.compile(r"(?:\s|#[^\n]*\n)*+sec\b", re.ASCII)
_BINDING = {"or": 1, "xor": 2, "and": 3}
_BINDING |= dict.fromkeys(("==", "!=", "<", ">", "<=", ">="), 5)
_BINDING |= {"+": 6, "-": 6, "*": 7, "/": 7, "%": 7}
_NOT_BINDING, _MINUS_BINDING = 4, 8


def tokens(text: str) -> list[Token]:
    """Raises ScriptError at the first character that begins no token."""
    if len(text) > MAX_CHARS:
        raise ScriptError(f"program longer than {MAX_CHARS} characters")
    found: list[Token] = []
    at, line = 0, 1
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ScriptError(f"line {line}: unexpected character {text[at]!r}")
        at = match.end()
        kind, word = str(match.lastgroup), match.group()
        if kind == "number" and _GOES_ON.match(text, at):
            raise ScriptError(f"line {line}: {word}{text[at]!s} is no number")
        if kind == "line":
            line += 1
        elif kind != "space":
            own = kind == "sign" or word in _KEYWORDS
            found.append(Token(word if own else kind, word, line))
    found.append(Token("end of program", "", line))
    return found


def is_secondary(text: str) -> bool:
    """A program that is to run beside the main one."""
    return _SECONDARY.match(text) is not None


def depth_change(line: str) -> int:
    """Blocks that one line of a program opens, less those that it closes."""
    words = [word for word in _BLOCKS.findall(line) if word]
    return len(words) - 2 * words.count("end")


def parse(text: str) -> Body:
    """Syntax tree of a whole program. Raises ScriptError."""
    return _Parser(tokens(text)).program()


class _Parser:
    """Recursive descent; nesting is bounded, so that no text can exhaust Python's stack."""

    def __init__(self, found: list[Token]) -> None:
        self._tokens = found
        self._at = 0
        self._depth = 0

    def program(self) -> Body:
        body = self._body("end of program")
        self._take("end of program")
        return body

    @property
    def _next(self) -> Token:
        return self._tokens[self._at]

    def _missing(self, expected: str) -> ScriptError:
        token = self._next
        return ScriptError(
            f"line {token.line}: {expected} expected, not {token.text or token.kind}"
        )

    def _take(self, kind: str) -> Token:
        token = self._next
        if token.kind != kind:
            raise self._missing(kind)
        self._at += 1
        return token

    def _took(self, kind: str) -> bool:
        found = self._next.kind == kind
        self._at += found
        return found

    def _same_line(self) -> bool:
        return self._next.line == self._tokens[self._at - 1].line

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise ScriptError(f"line {self._next.line}: nested more than {MAX_NESTING} deep")

    def _body(self, *ends: str) -> Body:
        self._deeper()
        found: list[Statement] = []
        while self._next.kind not in ends:
            found.append(self._statement())
        self._depth -= 1
        return tuple(found)

    def _block(self, *ends: str) -> Body:
        self._take(":")
        return self._body("end", *ends)

    def _statement(self) -> Statement:
        kind = self._next.kind
        if kind in _PLAIN:
            self._at += 1
            return Plain(kind)
        parsers: dict[str, Callable[[], Statement]] = {
            "def": self._function,
            "sec": self._function,
            "thread": self._function,
            "if": self._if,
            "while": self._while,
            "return": self._return,
            "kill": self._kill,
            "global": self._scoped,
            "local": self._scoped,
        }
        return parsers.get(kind, self._simple)()

    def _function(self) -> Function:
        thread = self._next.kind == "thread"
        self._at += 1
        name = self._take("name").text
        self._take("(")
        parameters: list[str] = []
        while not self._took(")"):
            parameters.append(self._take("name").text)
            if self._next.kind != ")":
                self._take(",")
        body = self._block()
        self._take("end")
        return Function(name, tuple(parameters), body, thread)

    def _if(self) -> If:
        branches: list[tuple[Expression, Body]] = []
        otherwise: Body = ()
        while self._took("elif" if branches else "if"):
            condition = self._expression()
            branches.append((condition, self._block("elif", "else")))
        if self._took("else"):
            otherwise = self._block()
        self._take("end")
        return If(tuple(branches), otherwise)

    def _while(self) -> While:
        self._at += 1
        condition = self._expression()
        body = self._block()
        self._take("end")
        return While(condition, body)

    def _return(self) -> Return:
        self._at += 1
        valued = self._same_line() and self._next.kind not in ("end", "end of program")
        return Return(self._expression() if valued else None)

    def _kill(self) -> Kill:
        self._at += 1
        return Kill(self._expression())

    def _scoped(self) -> Assign:
        scope = self._next.kind
        self._at += 1
        target = self._take("name").text
        self._take("=")
        return Assign(target, self._expression(), None, scope)

    def _simple(self) -> Assign | Evaluate:
        left = self._expression()
        if not self._took("="):
            return Evaluate(left)
        if isinstance(left, Name):
            return Assign(left.name, self._expression())
        if isinstance(left, Index) and isinstance(left.base, Name):
            return Assign(left.base.name, self._expression(), left.at)
        raise self._missing("a variable before =")

    def _expression(self, binding: int = 0) -> Expression:
        self._deeper()
        left = self._operand()
        start = self._at
        while (mine := _BINDING.get(self._next.kind, 0)) > binding:
            operator = self._next.kind
            self._check_length(start)
            self._at += 1
            left = Binary(operator, left, self._expression(mine))
        self._depth -= 1
        return left

    def _operand(self) -> Expression:
        kind = self._next.kind
        if kind == "not":
            self._at += 1
            return Unary("not", self._expression(_NOT_BINDING))
        if kind == "-":
            self._at += 1
            return Unary("-", self._expression(_MINUS_BINDING))
        return self._postfix(self._primary())

    def _check_length(self, start: int) -> None:
        """What is chained is nested in the tree, too."""
        if self._at - start > MAX_TOKENS:
            raise ScriptError(f"line {self._next.line}: expression too long")

    def _postfix(self, base: Expression) -> Expression:
        start = self._at
        while self._next.kind == "[" and self._same_line():
            self._check_length(start)
            self._at += 1
            base = Index(base, self._expression())
            self._take("]")
        return base

    def _primary(self) -> Expression:
        token = self._next
        self._at += 1
        if token.kind == "number":
            return Literal(_number(token))
        if token.kind == "text":
            return Literal(token.text[1:-1])
        if token.kind in ("True", "False"):
            return Literal(token.kind == "True")
        if token.kind == "(":
            inner = self._expression()
            self._take(")")
            return inner
        if token.kind == "[":
            return Sequence(self._items("]"), False)
        if token.kind == "run":
            return self._run()
        if token.kind == "name":
            return self._named(token.text)
        self._at -= 1
        raise self._missing("an expression")

    def _run(self) -> Run:
        name = self._take("name").text
        self._take("(")
        self._take(")")
        return Run(name)

    def _named(self, name: str) -> Expression:
        """A variable, a call, or a pose: ``p[0]`` is an element of p, with six items it is one."""
        if self._next.kind == "(" and self._same_line():
            self._at += 1
            return self._call(name)
        if name == "p" and self._next.kind == "[" and self._same_line():
            self._at += 1
            items = self._items("]")
            return Index(Name(name), items[0]) if len(items) == 1 else Sequence(items, True)
        return Name(name)

    def _items(self, end: str) -> tuple[Expression, ...]:
        found: list[Expression] = []
        while not self._took(end):
            found.append(self._expression())
            if self._next.kind != end:
                self._take(",")
        return tuple(found)

    def _call(self, name: str) -> Call:
        positional: list[Expression] = []
        named: list[tuple[str, Expression]] = []
        while not self._took(")"):
            value = self._expression()
            if isinstance(value, Name) and self._took("="):
                named.append((value.name, self._expression()))
            elif named:
                raise self._missing("a named argument")
            else:
                positional.append(value)
            if self._next.kind != ")":
                self._take(",")
        return Call(name, tuple(positional), tuple(named))


def _number(token: Token) -> int | float:
    if len(token.text) > _MAX_DIGITS:
        raise ScriptError(f"line {token.line}: number of more than {_MAX_DIGITS} characters")
    if not token.text.isdigit():
        return float(token.text)
    if int(token.text) >= _INT_END:
        raise ScriptError(f"line {token.line}: integer beyond 32 bits")
    return int(token.text)
