"""From the syntax tree of a URScript program to what `urscript.run` runs."""

import inspect
from collections.abc import Mapping

import drivers.ur.emulator.urscript.syntax as syntax
from drivers.ur.emulator.urscript.parse import ScriptError, parse
from drivers.ur.emulator.urscript.run import (
    BREAK,
    CONTINUE,
    OPERATORS,
    RETURN,
    Builtin,
    Code,
    Compiled,
    Halt,
    Scope,
    Steps,
    UserFunction,
    Value,
    check_arguments,
    copied,
    lift,
    make_list,
    make_pose,
    negative,
    position_in,
)


def compile_program(text: str, builtins: Mapping[str, Builtin]) -> Compiled:
    """Raises ScriptError for text that is no program, or that names what does not exist."""
    body = parse(text)
    if len(body) == 1 and isinstance(body[0], syntax.Function):
        main = body[0]
    else:
        main = syntax.Function("unnamed", (), body, False)
    if main.parameters:
        raise ScriptError("a program takes no parameters")
    try:
        return _Compiler(main, builtins).program()
    except RecursionError:
        raise ScriptError("nested too deep") from None


class _Compiler:
    """Knows all functions and global names of one program."""

    def __init__(self, main: syntax.Function, builtins: Mapping[str, Builtin]) -> None:
        self._main = main
        self._builtins = builtins
        statements = list(syntax.inside(main.body))
        defined = [one for one in statements if isinstance(one, syntax.Function)]
        self._functions = {one.name: UserFunction(one) for one in defined}
        self._definitions = defined
        self._shared = {
            one.target
            for one in statements
            if isinstance(one, syntax.Assign) and one.scope == "global"
        }

    def program(self) -> Compiled:
        for definition in self._definitions:
            self._fill(self._functions[definition.name], definition)
        main = UserFunction(self._main)
        self._fill(main, self._main)
        return Compiled(self._main.name, main)

    def _fill(self, function: UserFunction, definition: syntax.Function) -> None:
        body = _Body(self._functions, self._builtins, self._shared, definition)
        function.body = body.code()


class _Body:
    """Compiles one function."""

    def __init__(
        self,
        functions: Mapping[str, UserFunction],
        builtins: Mapping[str, Builtin],
        shared: set[str],
        definition: syntax.Function,
    ) -> None:
        self._functions = functions
        self._builtins = builtins
        self._body = definition.body
        inside = syntax.inside(definition.body)
        own = [one for one in inside if isinstance(one, syntax.Assign)]
        local = {one.target for one in own if one.scope == "local"} | set(definition.parameters)
        self._shared = shared - local
        self._known = self._shared | local | {one.target for one in own}

    def code(self) -> Code:
        return self._block(self._body)

    # statements

    def _block(self, block: syntax.Body) -> Code:
        body: list[syntax.Statement] = [
            one for one in block if not isinstance(one, syntax.Function)
        ]
        codes = [self._statement(one) for one in body]
        plain = [code.now for code in codes if code.now is not None]

        def now(scope: Scope) -> Value:
            for run in plain:
                if (signal := run(scope)) is not None:
                    return signal
            return None

        def steps(scope: Scope) -> Steps:
            for code in codes:
                signal = code.now(scope) if code.now else (yield from code.steps(scope))
                if signal is not None:
                    return signal
            return None

        return Code(now) if len(plain) == len(codes) else Code(None, steps)

    def _statement(self, statement: syntax.Statement) -> Code:
        match statement:
            case syntax.Assign():
                return self._assign(statement)
            case syntax.Evaluate(value):
                return lift(lambda scope, value: None, [self._expression(value)])
            case syntax.If():
                return self._if(statement)
            case syntax.While():
                return self._while(statement)
            case syntax.Return(value):
                return self._return(value)
            case syntax.Kill(handle):
                return lift(_kill, [self._expression(handle)])
            case syntax.Plain(word):
                return Code(_PLAIN[word])
        raise ScriptError(f"{type(statement).__name__} is not a statement here")

    def _assign(self, statement: syntax.Assign) -> Code:
        name = statement.target
        shared = statement.scope == "global" or name in self._shared

        def assign(scope: Scope, value: Value) -> None:
            scope.put(name, copied(value), shared)

        def assign_element(scope: Scope, at: Value, value: Value) -> None:
            scope.put_element(name, at, value)

        value = self._expression(statement.value)
        if statement.at is None:
            return lift(assign, [value])
        return lift(assign_element, [self._expression(statement.at), value])

    def _if(self, statement: syntax.If) -> Code:
        branches = [(self._expression(c), self._block(body)) for c, body in statement.branches]
        otherwise = self._block(statement.otherwise)
        plain = [(c.now, b.now) for c, b in branches if c.now is not None and b.now is not None]

        def now(scope: Scope) -> Value:
            for condition, body in plain:
                if condition(scope):
                    return body(scope)
            return otherwise.now(scope) if otherwise.now else None

        def steps(scope: Scope) -> Steps:
            for condition, body in branches:
                if condition.now(scope) if condition.now else (yield from condition.steps(scope)):
                    return (yield from body.steps(scope))
            return (yield from otherwise.steps(scope))

        plainly = len(plain) == len(branches) and otherwise.now is not None
        return Code(now) if plainly else Code(None, steps)

    def _while(self, statement: syntax.While) -> Code:
        condition, body = self._expression(statement.condition), self._block(statement.body)

        def steps(scope: Scope) -> Steps:
            while (yield from condition.steps(scope)):
                scope.thread.spend()
                signal = yield from body.steps(scope)
                if signal == BREAK:
                    break
                if signal == RETURN:
                    return signal
            return None

        return Code(None, steps)

    def _return(self, value: syntax.Expression | None) -> Code:
        def give(scope: Scope, value: Value = None) -> str:
            scope.result = value
            return RETURN

        return lift(give, [] if value is None else [self._expression(value)])

    # expressions

    def _expression(self, expression: syntax.Expression) -> Code:
        match expression:
            case syntax.Literal(value):
                return Code(lambda scope: value)
            case syntax.Name(name):
                return self._name(name)
            case syntax.Sequence(items, pose):
                return self._sequence(items, pose)
            case syntax.Index(base, at):
                return lift(_element, [self._expression(base), self._expression(at)])
            case syntax.Call():
                return self._call(expression)
            case syntax.Run(name):
                return self._run(name)
            case syntax.Unary(sign, operand):
                function = negative if sign == "-" else _negation
                return lift(lambda scope, value: function(value), [self._expression(operand)])
        return self._binary(expression)

    def _name(self, name: str) -> Code:
        if name not in self._known:
            raise ScriptError(f"name {name} is not defined")
        return Code(lambda scope: scope[name])

    def _sequence(self, items: tuple[syntax.Expression, ...], pose: bool) -> Code:
        make = make_pose if pose else make_list
        return lift(lambda scope, *values: make(values), [self._expression(item) for item in items])

    def _binary(self, expression: syntax.Binary) -> Code:
        left, right = self._expression(expression.left), self._expression(expression.right)
        if expression.operator in ("and", "or"):
            return _short_circuit(expression.operator == "or", left, right)
        apply = OPERATORS[expression.operator]
        return lift(lambda scope, a, b: apply(a, b), [left, right])

    def _run(self, name: str) -> Code:
        function = self._functions.get(name)
        if function is None or not function.thread:
            raise ScriptError(f"thread {name} is not defined")
        return Code(lambda scope: scope.thread.program.start(function))

    def _call(self, call: syntax.Call) -> Code:
        operands = [*call.positional, *(value for _, value in call.named)]
        arguments = [self._expression(one) for one in operands]
        function = self._functions.get(call.name)
        if function is not None:
            return self._user_call(function, call, arguments)
        builtin = self._builtins.get(call.name)
        if builtin is None:
            raise ScriptError(f"function {call.name} is not defined")
        check_arguments(builtin, call)
        keys = [key for key, _ in call.named]
        count = len(call.positional)

        def apply(scope: Scope, *values: Value) -> Value:
            named = dict(zip(keys, values[count:], strict=True))
            return builtin(scope.thread, *values[:count], **named)

        waits = inspect.isgeneratorfunction(builtin)
        return _waiting(apply, arguments) if waits else lift(apply, arguments)

    def _user_call(self, function: UserFunction, call: syntax.Call, arguments: list[Code]) -> Code:
        if function.thread or call.named or len(arguments) != len(function.parameters):
            raise ScriptError(f"{call.name} cannot be called like this")
        return _waiting(lambda scope, *values: function.call(scope.thread, values), arguments)


def _waiting(operation: Builtin, operands: list[Code]) -> Code:
    """As ``lift``, for an operation that is a generator."""
    prepared = lift(operation, operands)

    def steps(scope: Scope) -> Steps:
        started = prepared.now(scope) if prepared.now else (yield from prepared.steps(scope))
        return (yield from started)

    return Code(None, steps)


def _short_circuit(stop_at: bool, left: Code, right: Code) -> Code:
    first, second = left.now, right.now

    def steps(scope: Scope) -> Steps:
        value = bool((yield from left.steps(scope)))
        return value if value == stop_at else bool((yield from right.steps(scope)))

    if first is None or second is None:
        return Code(None, steps)
    if stop_at:
        return Code(lambda scope: bool(first(scope)) or bool(second(scope)))
    return Code(lambda scope: bool(first(scope)) and bool(second(scope)))


def _element(scope: Scope, values: Value, at: Value) -> Value:
    return values[position_in(values, at)]


def _negation(value: Value) -> bool:
    return not value


def _kill(scope: Scope, handle: Value) -> None:
    scope.thread.program.kill(handle, scope.thread)


def _halt(scope: Scope) -> None:
    raise Halt


def _enter(scope: Scope) -> None:
    scope.thread.program.critical = scope.thread


def _exit(scope: Scope) -> None:
    scope.thread.program.critical = None


_PLAIN = {
    "break": lambda scope: BREAK,
    "continue": lambda scope: CONTINUE,
    "halt": _halt,
    "enter_critical": _enter,
    "exit_critical": _exit,
}
