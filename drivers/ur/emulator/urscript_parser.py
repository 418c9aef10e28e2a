"""URScript (Universal Robots, "The URScript Programming Language") translated to Python.

It supports what ur_rtde's control script uses: functions, threads, ``if``, ``while``, assignments,
lists, poses, calls with named arguments; one statement a line. A function becomes a generator
function that yields where the program waits for the next cycle. Only literals, operators and calls
of known functions are translated, and names get a prefix: ``v_`` for variables, ``f_`` for the
program's functions, ``b_`` for built-in ones. So a program reaches nothing else of Python.
"""

import ast
import functools
import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping
from types import CodeType
from typing import Any, NamedTuple

from drivers.ur.emulator.urscript_values import INT_RANGE, OPERATORS, ScriptError

# first argument: the calling thread; a generator function waits for cycles
Builtin = Callable[..., Any]

MAX_CHARS = 100_000  # ur_rtde uploads 42,000
_MAX_LINE_CHARS = 1000
# ur_rtde fills in its register offsets on the line after the comment
_FILLED_IN = re.compile(r"=[ \t]*#[^\n]*\n[ \t]*(\d+)[ \t]*")
_COMMENT = re.compile(r'("[^"]*")|#.*')
_NAME = r"[A-Za-z_]\w*"
_TOKEN = re.compile(rf'"(?P<text>[^"]*)"|\b(?P<name>{_NAME})', re.ASCII)
_DEFINE = re.compile(rf"(?P<name>{_NAME})\s*\((?P<parameters>[\w\s,]*)\):", re.ASCII)
_ASSIGN = re.compile(
    rf"(?P<shared>global\s+)?(?P<name>{_NAME})\s*(?:\[(?P<at>.+)\])?\s*=(?!=)(?P<value>.+)",
    re.ASCII,
)
_RUN = re.compile(rf"run\s+({_NAME})\s*\(\)", re.ASCII)
_WORDS = {"and", "or", "not", "True", "False"}
_OPENING = re.compile(r"\s*(def|sec|thread|if|while)\b", re.ASCII)
_CLOSING = re.compile(r"\s*end\b", re.ASCII)
_INVALID = (SyntaxError, ValueError, MemoryError, RecursionError)  # raised by Python's parser


class Script(NamedTuple):
    """A translated program: its code defines its functions, the main one as ``f_<name>``."""

    name: str
    code: CodeType
    builtins: Mapping[str, Builtin]


def parse(text: str, builtins: Mapping[str, Builtin]) -> Script:
    """Translated program. Raises ScriptError for invalid text or undefined names."""
    if len(text) > MAX_CHARS:
        raise ScriptError(f"program longer than {MAX_CHARS} characters")
    translator = _Translator(builtins)
    try:
        for line in _FILLED_IN.sub(r"= \1\n", text).split("\n"):
            translator.take(line)
        name = translator.main()
        return Script(name, compile(translator.source(), "<URScript>", "exec"), builtins)
    except _INVALID as error:
        raise ScriptError(f"invalid program: {error}") from None


def depth_change(line: str) -> int:
    """1 for a line that opens a block, -1 for one that closes a block, else 0."""
    return bool(_OPENING.match(line)) - bool(_CLOSING.match(line))


class _Function:
    """Function or thread of the program, with the Python lines of its body."""

    def __init__(self, name: str, parameters: list[str], is_thread: bool) -> None:
        self.name = name
        self.parameters = parameters  # with their prefix
        self.is_thread = is_thread
        self.body: list[str] = []
        self.level = 1  # open blocks, the function's included

    def add(self, line: str) -> None:
        """Add a statement, which is a step of its thread."""
        self.body.append(f"{' ' * self.level}thread.spend(); {line}")

    def open(self, line: str, again: bool) -> None:
        """Open a block; ``again`` closes the one before it."""
        self.level -= again
        self.body.append(" " * self.level + line)
        self.level += 1
        self.add("pass")  # a block may be empty

    def source(self, shared: set[str]) -> Iterator[str]:
        yield f"def f_{self.name}({', '.join(['thread', *self.parameters])}):"
        if names := sorted(shared.difference(self.parameters)):
            yield f" global {', '.join(names)}"
        yield " yield from ()"
        yield " thread.spend()"
        yield from (f" {name} = copied({name})" for name in self.parameters)
        yield from self.body


class _Translator:
    """Translates the lines of one program, in order."""

    def __init__(self, builtins: Mapping[str, Builtin]) -> None:
        self._builtins = builtins
        self._functions: dict[str, _Function] = {}
        self._outer: list[str] = []  # functions that are in no other one
        # functions being defined, innermost last; the first holds the statements outside them all
        self._open = [_Function("unnamed", [], False)]
        # calls with their number of arguments; None: start of a thread
        self._calls: list[tuple[str, int | None]] = []
        self._shared: set[str] = set()
        self._assigned: set[str] = set()
        self._read: set[str] = set()
        self._number = 0  # of the line
        self._statement = ""

    def main(self) -> str:
        """Name of the main function; checks all names."""
        program = self._open[-1]
        if len(self._open) > 1 or program.level > 1:
            raise ScriptError(f"a block of {program.name} has no end")
        if len(self._outer) == 1 and not program.body:
            program = self._functions[self._outer[0]]
        self._functions[program.name] = program
        if program.parameters:
            raise ScriptError("a program takes no parameters")
        for name, count in self._calls:
            if (function := self._functions.get(name)) is None:
                raise ScriptError(f"function {name} is not defined")
            if count != (None if function.is_thread else len(function.parameters)):
                raise ScriptError(f"{name} cannot be called like this")
        if unknown := sorted(self._read - self._assigned):
            raise ScriptError(f"name {unknown[0].removeprefix('v_')} is not defined")
        return program.name

    def source(self) -> str:
        """Python source of all functions."""
        functions = self._functions.values()
        return "\n".join(line for each in functions for line in each.source(self._shared))

    def _refuse(self, why: str = "not emulated") -> ScriptError:
        return ScriptError(f"line {self._number}: {why}: {self._statement:.200}")

    # statements

    def take(self, line: str) -> None:
        """Translate one line."""
        self._number += 1
        self._statement = statement = _COMMENT.sub(r"\1", line).strip()
        if len(statement) > _MAX_LINE_CHARS:
            raise self._refuse(f"longer than {_MAX_LINE_CHARS} characters")
        word = re.match(r"\w*", statement, re.ASCII)
        if statement and word:
            self._take(word[0], statement[word.end() :].strip())

    def _take(self, word: str, rest: str) -> None:
        function = self._open[-1]
        match word:
            case "def" | "thread":
                self._define(rest, word == "thread")
            case "if" | "while" | "elif":
                if not rest.endswith(":"):
                    raise self._refuse("a colon expected")
                condition = f"thread.spend() and {self._value_of(rest[:-1])}"
                function.open(f"{word} {condition}:", again=word == "elif")
            case "else" if rest == ":":
                function.open("else:", again=True)
            case "end" if not rest and function.level > 1:
                function.level -= 1
            case "end" if not rest and len(self._open) > 1:
                self._open.pop()
            case "return":
                function.add(f"return {self._value_of(rest) if rest else ''}")
            case "break" | "continue" if not rest:
                function.add(word)
            case "join" | "kill":
                call = f"thread.program.{word}({self._value_of(rest)}, thread)"
                function.add(f"yield from {call}" if word == "join" else call)
            case "enter_critical" | "exit_critical" if not rest:
                holder = "thread" if word == "enter_critical" else "None"
                function.add(f"thread.program.critical = {holder}")
            case _:
                function.add(self._assignment() or self._value_of(self._statement))

    def _define(self, rest: str, is_thread: bool) -> None:
        found = _DEFINE.fullmatch(rest)
        if found is None:
            raise self._refuse("a name and parameters expected")
        name = found["name"]
        if name in self._builtins or name in self._functions:
            raise self._refuse(f"{name} is defined already")
        parameters = [
            f"v_{each.strip()}" for each in found["parameters"].split(",") if each.strip()
        ]
        self._assigned.update(parameters)
        if len(self._open) == 1:
            self._outer.append(name)
        self._functions[name] = _Function(name, parameters, is_thread)
        self._open.append(self._functions[name])

    def _assignment(self) -> str | None:
        """The statement as an assignment, which copies lists; None when it is no assignment."""
        found = _ASSIGN.fullmatch(self._statement)
        if found is None:
            return None
        name, value = f"v_{found['name']}", self._value_of(found["value"])
        if found["at"] is not None:
            self._read.add(name)
            return f"set_element({name}, {self._value_of(found['at'])}, {value})"
        self._assigned.add(name)
        if found["shared"]:
            self._shared.add(name)
        return f"{name} = copied({value})"

    # expressions

    def _value_of(self, text: str) -> str:
        """Python expression with the value of this one."""
        if started := _RUN.fullmatch(text.strip()):
            self._calls.append((started[1], None))
            return f"thread.program.start(f_{started[1]})"
        if "'" in _TOKEN.sub("", text):
            raise self._refuse("a string is in double quotes")
        try:
            return self._value(ast.parse(_TOKEN.sub(_prefixed, text).strip(), mode="eval").body)
        except _INVALID:
            raise self._refuse() from None

    def _value(self, node: ast.expr) -> str:
        match node:
            case ast.Constant(value=bool() | str() as value):
                return repr(value)
            case ast.Constant(value=int() | float() as value) if value < _LARGEST[type(value)]:
                return repr(value)
            case ast.Name(id=name) if name.startswith("v_"):
                self._read.add(name)
                return name
            case ast.Call(func=ast.Name(id=name), args=positional, keywords=named):
                return self._call(name.removeprefix("v_"), positional, named)
            case ast.BoolOp(op=sign, values=values):
                word = " and " if isinstance(sign, ast.And) else " or "
                return f"({word.join(map(self._value, values))})"
            case ast.UnaryOp(op=ast.Not(), operand=value):
                return f"(not {self._value(value)})"
        return self._applied(*self._operation(node))

    def _operation(self, node: ast.expr) -> tuple[str, list[ast.expr]]:
        """Function of the run time that computes an operation, and its operands."""
        match node:
            case ast.List(elts=items):
                return "make_list", items
            case ast.Subscript(value=ast.Name(id="v_p"), slice=ast.Tuple(elts=items)):
                return "make_pose", items
            case ast.Subscript(value=values, slice=at):
                return "element", [values, at]
            case ast.UnaryOp(op=ast.USub(), operand=value):
                return "negative", [value]
            case (
                ast.BinOp(left=left, op=sign, right=right)
                | ast.Compare(left=left, ops=[sign], comparators=[right])
            ) if type(sign).__name__ in OPERATORS:
                return type(sign).__name__, [left, right]
        raise self._refuse()

    def _applied(self, function: str, operands: list[ast.expr]) -> str:
        return f"{function}({', '.join(map(self._value, operands))})"

    def _call(self, name: str, positional: list[ast.expr], named: list[ast.keyword]) -> str:
        values = {str(each.arg).removeprefix("v_"): self._value(each.value) for each in named}
        arguments = ["thread", *map(self._value, positional)]
        builtin = self._builtins.get(name)
        if builtin is None:
            if values:
                raise self._refuse("no named arguments allowed")
            self._calls.append((name, len(positional)))
            return f"(yield from f_{name}({', '.join(arguments)}))"
        try:
            _signature(builtin).bind(*arguments, **values)
        except TypeError as error:
            raise self._refuse(str(error)) from None
        call = f"b_{name}({', '.join(arguments + [f'{key}={values[key]}' for key in values])})"
        return f"(yield from {call})" if inspect.isgeneratorfunction(builtin) else call


_signature = functools.cache(inspect.signature)
_LARGEST = {int: INT_RANGE, float: math.inf}


def _prefixed(token: re.Match[str]) -> str:
    """A name with its prefix; a string as a Python literal."""
    if token["text"] is not None:
        return repr(token["text"])
    return token["name"] if token["name"] in _WORDS else f"v_{token['name']}"
