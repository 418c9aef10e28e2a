"""Parser of URScript (Universal Robots, "The URScript Programming Language") to a syntax tree.

It supports the part of the language that ur_rtde's control script uses: functions, threads, ``if``,
``while``, assignments, lists, poses, calls with named arguments. A line end only ends comments,
``return`` values and calls, as on the controller. Text is never run as Python.
"""

import functools
import inspect
import operator
import re
from collections.abc import Mapping
from typing import NamedTuple

from drivers.ur.emulator import urscript as tree
from drivers.ur.emulator.urscript import Builtin, Function, Node
from drivers.ur.emulator.urscript_values import (
    OPERATORS,
    ScriptError,
    make_list,
    make_pose,
    negative,
)

MAX_CHARS = 250_000
MAX_NESTING = 60  # of blocks, brackets and chained operators
_MAX_DIGITS = 40
_INT_END = 2**31


class Token(NamedTuple):
    """Token; ``kind`` is "number", "text", "name", the word itself for keywords and signs, or "end
    of program"."""

    kind: str
    text: str
    line: int


_WORDS = """
    and break continue def elif else end enter_critical exit_critical False global if join kill not
    or return run sec thread True while
"""
_KEYWORDS = frozenset(_WORDS.split())
_TOKEN = re.compile(
    r"(?P<space>[ \t\r\f]+|#[^\n]*)"
    r"|(?P<line>\n)"
    r"|(?P<number>(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+(?![\w.]))"
    r"|(?P<name>[A-Za-z_]\w*)"
    r'|(?P<text>"[^"\n]*")'
    r"|(?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:])"
    r"|(?P<other>.)",
    re.ASCII | re.DOTALL,
)
# words that open or end a block; other words, strings and comments are skipped
_BLOCKS = re.compile(r'#[^\n]*|"[^"\n]*"|(def|sec|thread|if|while|end)\b|[A-Za-z_]\w*', re.ASCII)
_SECONDARY = re.compile(r"(?:\s|#[^\n]*\n)*+sec\b", re.ASCII)
_PRECEDENCE = {"or": 1, "and": 3, "+": 6, "-": 6, "*": 7, "/": 7, "%": 7}
_PRECEDENCE |= dict.fromkeys(("==", "!=", "<", ">", "<=", ">="), 5)
_NOT_PRECEDENCE, _MINUS_PRECEDENCE = 4, 8


def parse(text: str, builtins: Mapping[str, Builtin]) -> Function:
    """Main function of a program. Raises ScriptError for invalid text or undefined names."""
    return _Parser(_tokens(text), builtins).program()


def is_secondary(text: str) -> bool:
    """Whether a program is to run beside the main one."""
    return _SECONDARY.match(text) is not None


def depth_change(line: str) -> int:
    """Blocks that one line opens, minus those that it closes."""
    words = [word for word in _BLOCKS.findall(line) if word]
    return len(words) - 2 * words.count("end")


def _tokens(text: str) -> list[Token]:
    if len(text) > MAX_CHARS:
        raise ScriptError(f"program longer than {MAX_CHARS} characters")
    found: list[Token] = []
    line = 1
    for match in _TOKEN.finditer(text):
        kind, word = str(match.lastgroup), match.group()
        if kind == "other":
            raise ScriptError(f"line {line}: unexpected character {word!r}")
        if kind == "line":
            line += 1
        elif kind != "space":
            literal = kind == "sign" or word in _KEYWORDS
            found.append(Token(word if literal else kind, word, line))
    found.append(Token("end of program", "", line))
    return found


class _Parser:
    """Recursive-descent parser with bounded nesting, so that no text exhausts Python's stack."""

    def __init__(self, tokens: list[Token], builtins: Mapping[str, Builtin]) -> None:
        self._tokens = tokens
        self._builtins = builtins
        self._position = 0
        self._depth = 0
        self._functions: dict[str, Function] = {}
        # calls with their number of arguments; None: start of a thread
        self._calls: list[tuple[Function, int | None]] = []
        self._assigned: set[str] = set()
        self._read: set[str] = set()

    def program(self) -> Function:
        body, defined = self._body("end of program")
        main = Function("unnamed")
        main.body = body
        if len(defined) == 1 and not body.parts:
            (main,) = defined
        if main.parameters:
            raise ScriptError("a program takes no parameters")
        for function, count in self._calls:
            if function.body is None:
                raise ScriptError(f"function {function.name} is not defined")
            expected = None if function.is_thread else len(function.parameters)
            if count != expected:
                raise ScriptError(f"{function.name} cannot be called like this")
        if unknown := sorted(self._read - self._assigned):
            raise ScriptError(f"name {unknown[0]} is not defined")
        return main

    # tokens

    @property
    def _next(self) -> Token:
        return self._tokens[self._position]

    def _syntax_error(self, expected: str) -> ScriptError:
        token = self._next
        return ScriptError(
            f"line {token.line}: {expected} expected, not {token.text or token.kind}"
        )

    def _expect(self, kind: str) -> Token:
        token = self._next
        if token.kind != kind:
            raise self._syntax_error(kind)
        self._position += 1
        return token

    def _accept(self, kind: str) -> bool:
        found = self._next.kind == kind
        self._position += found
        return found

    def _same_line(self) -> bool:
        return self._next.line == self._tokens[self._position - 1].line

    def _enter_level(self) -> None:
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise ScriptError(f"line {self._next.line}: nested more than {MAX_NESTING} deep")

    # statements

    def _body(self, *ends: str) -> tuple[tree.Block, list[Function]]:
        """Statements up to one of these words, and the functions that they define."""
        self._enter_level()
        statements: list[Node] = []
        defined: list[Function] = []
        while (kind := self._next.kind) not in ends:
            if kind in ("def", "sec", "thread"):
                defined.append(self._definition())
            else:
                statements.append(self._statement())
        self._depth -= 1
        return tree.Block(*statements), defined

    def _block(self, *ends: str) -> tree.Block:
        self._expect(":")
        return self._body("end", *ends)[0]

    def _definition(self) -> Function:
        is_thread = self._next.kind == "thread"
        self._position += 1
        function = self._function(self._expect("name").text)
        function.is_thread = is_thread
        self._expect("(")
        parameters: list[str] = []
        while not self._accept(")"):
            parameters.append(self._expect("name").text)
            if self._next.kind != ")":
                self._expect(",")
        function.parameters = tuple(parameters)
        self._assigned.update(parameters)
        function.body = self._block()
        self._expect("end")
        return function

    def _function(self, name: str) -> Function:
        if name in self._builtins:
            raise ScriptError(f"{name} is a function of the controller")
        return self._functions.setdefault(name, Function(name))

    def _statement(self) -> Node:
        match self._next.kind:
            case "if":
                return self._if()
            case "while":
                self._position += 1
                loop = tree.While(self._expression(), self._block())
                self._expect("end")
                return loop
            case "return":
                self._position += 1
                valued = self._same_line() and self._next.kind not in ("end", "end of program")
                return tree.Return(*([self._expression()] if valued else []))
            case "join" | "kill" as word:
                self._position += 1
                return (tree.Join if word == "join" else tree.Kill)(self._expression())
            case "enter_critical" | "exit_critical" as word:
                self._position += 1
                return tree.Critical(word == "enter_critical")
            case "break" | "continue" as word:
                self._position += 1
                return tree.Literal(tree.BREAK if word == "break" else tree.CONTINUE)
            case "global":
                self._position += 1
                name = self._expect("name").text
                self._expect("=")
                return self._assign(name, True)
        return self._simple()

    def _if(self) -> tree.If:
        branches: list[tuple[Node, tree.Block]] = []
        while self._accept("elif" if branches else "if"):
            condition = self._expression()
            branches.append((condition, self._block("elif", "else")))
        if self._accept("else"):
            branches.append((tree.Literal(True), self._block()))
        self._expect("end")
        return tree.If(branches)

    def _assign(self, name: str, shared: bool) -> tree.Assign:
        self._assigned.add(name)
        return tree.Assign(name, self._expression(), shared)

    def _simple(self) -> Node:
        left = self._expression()
        if not self._accept("="):
            return tree.Evaluate(left)
        if isinstance(left, tree.Name):
            return self._assign(left.name, False)
        if isinstance(left, tree.Index) and isinstance(left.parts[0], tree.Name):
            return tree.AssignElement(left.parts[0].name, left.parts[1], self._expression())
        raise self._syntax_error("a variable before =")

    # expressions

    def _expression(self, least_precedence: int = 0) -> Node:
        depth = self._depth
        self._enter_level()
        left = self._operand()
        while (precedence := _PRECEDENCE.get(self._next.kind, 0)) > least_precedence:
            self._enter_level()  # chained operators are nested in the tree, too
            sign = self._next.kind
            self._position += 1
            right = self._expression(precedence)
            logical = sign in ("and", "or")
            left = (
                tree.Logical(sign, left, right)
                if logical
                else tree.Operation(OPERATORS[sign], left, right)
            )
        self._depth = depth
        return left

    def _operand(self) -> Node:
        if self._accept("not"):
            return tree.Operation(operator.not_, self._expression(_NOT_PRECEDENCE))
        if self._accept("-"):
            return tree.Operation(negative, self._expression(_MINUS_PRECEDENCE))
        base = self._primary()
        depth = self._depth
        while self._next.kind == "[" and self._same_line():
            self._enter_level()
            self._position += 1
            base = tree.Index(base, self._expression())
            self._expect("]")
        self._depth = depth
        return base

    def _primary(self) -> Node:
        token = self._next
        self._position += 1
        match token.kind:
            case "number":
                return tree.Literal(_number(token))
            case "text":
                return tree.Literal(token.text[1:-1])
            case "True" | "False":
                return tree.Literal(token.kind == "True")
            case "(":
                inner = self._expression()
                self._expect(")")
                return inner
            case "[":
                return tree.Operation(make_list, *self._items())
            case "run":
                return self._run()
            case "name":
                return self._named(token.text)
        self._position -= 1
        raise self._syntax_error("an expression")

    def _run(self) -> tree.Run:
        function = self._function(self._expect("name").text)
        self._expect("(")
        self._expect(")")
        self._calls.append((function, None))
        return tree.Run(function)

    def _named(self, name: str) -> Node:
        """A variable, a call, or a pose: ``p[0]`` is an element of p, ``p`` with six items is a
        pose."""
        if self._next.kind == "(" and self._same_line():
            self._position += 1
            return self._call(name)
        if name == "p" and self._next.kind == "[" and self._same_line():
            self._position += 1
            items = self._items()
            if len(items) != 1:
                return tree.Operation(make_pose, *items)
            self._read.add(name)
            return tree.Index(tree.Name(name), items[0])
        if self._next.kind != "=":
            self._read.add(name)
        return tree.Name(name)

    def _items(self) -> list[Node]:
        found: list[Node] = []
        while not self._accept("]"):
            found.append(self._expression())
            if self._next.kind != "]":
                self._expect(",")
        return found

    def _call(self, name: str) -> tree.Call:
        values: list[Node] = []
        keys: list[str] = []
        while not self._accept(")"):
            value = self._expression()
            if isinstance(value, tree.Name) and self._accept("="):
                keys.append(value.name)
                value = self._expression()
            elif keys:
                raise self._syntax_error("a named argument")
            values.append(value)
            if self._next.kind != ")":
                self._expect(",")
        builtin = self._builtins.get(name)
        if builtin is not None:
            _check_arguments(name, builtin, len(values) - len(keys), keys)
            waits = inspect.isgeneratorfunction(builtin)
            return tree.Call(builtin, *values, keys=tuple(keys), waits=waits)
        function = self._function(name)
        if keys:
            raise ScriptError(f"{name} takes no named arguments")
        self._calls.append((function, len(values)))
        return tree.Call(function.call, *values, waits=True)


_signature = functools.cache(inspect.signature)


def _check_arguments(name: str, builtin: Builtin, positional: int, keys: list[str]) -> None:
    try:
        _signature(builtin).bind(None, *[None] * positional, **dict.fromkeys(keys))
    except TypeError as error:
        raise ScriptError(f"{name}: {error}") from None


def _number(token: Token) -> int | float:
    if len(token.text) > _MAX_DIGITS:
        raise ScriptError(f"line {token.line}: number of more than {_MAX_DIGITS} characters")
    if not token.text.isdigit():
        return float(token.text)
    if int(token.text) >= _INT_END:
        raise ScriptError(f"line {token.line}: integer beyond 32 bits")
    return int(token.text)
