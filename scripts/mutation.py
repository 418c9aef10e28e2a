"""Mutants of a module: every place at which one of the named operators changes it.

Left alone are annotations (the ranges of settings have tests of their own, generated from them),
docstrings, the texts of messages, `__all__`, options of classes, protocols, and zip's `strict`:
none of them computes anything.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import msgspec

HOME = Path(__file__).resolve().parent.parent
MODULE = "<module>"
MOST_TOLD = 100

OPPOSITE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
BESIDE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.Pow: ast.Mult,
}  # fmt: skip
EXTREMUM = {"min": "max", "max": "min", "any": "all", "all": "any"}
EXTREMUM |= {"minimum": "maximum", "maximum": "minimum"}


class Mutant(msgspec.Struct, frozen=True, order=True):
    """A change of one place. ``nth``: of the same changes of one function, in reading order."""

    path: str
    where: str  # qualified name of the function, `<module>` or the class for what runs on import
    operator: str
    was: str
    becomes: str
    nth: int = 0

    def __str__(self) -> str:
        nth = f" ({self.nth + 1})" if self.nth else ""
        return f"{self.path} {self.where} {self.operator}: {self.was} -> {self.becomes}{nth}"


class Place(msgspec.Struct, frozen=True):
    """Where a mutant's change is in its file: a node's number in the tree, and which of its
    edits."""

    node: int
    edit: int
    line: int
    on_import: bool  # what runs when the module is imported, or is compiled before


Edits = list[tuple[str, ast.AST]]


def edits(node: ast.AST, parent: ast.AST | None) -> Edits:
    """The operators that apply to a node, and what each makes of it."""
    called = isinstance(parent, ast.Call)
    return _of_statement(node) or _of_branch(node) or _of_value(node, called) or _of_sign(node)


def _of_sign(node: ast.AST) -> Edits:
    match node:
        case ast.Compare(left, ops, comparators):
            return _compared(left, ops, comparators)
        case ast.BinOp(left, op, right) if type(op) in ARITHMETIC:
            return [("arithmetic", ast.BinOp(left, ARITHMETIC[type(op)](), right))]
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            return [("arithmetic", operand)]
        case ast.UnaryOp(ast.Not(), operand):
            return [("boolean negation", operand)]
        case ast.BoolOp(op, values):
            other = ast.Or() if isinstance(op, ast.And) else ast.And()
            return [("boolean negation", ast.BoolOp(other, values))]
    return []


def _of_value(node: ast.AST, called: bool) -> Edits:
    match node:
        case ast.Constant(value) if isinstance(value, bool):
            return [("constant", ast.Constant(not value))]
        case ast.Constant(value) if isinstance(value, int | float):
            return [("constant", ast.Constant(_other(value)))]
        case ast.Name(id) if id in EXTREMUM and called:
            return [("extremum", ast.Name(EXTREMUM[id], ast.Load()))]
        case ast.Attribute(value, attr) if attr in EXTREMUM and called:
            return [("extremum", ast.Attribute(value, EXTREMUM[attr], ast.Load()))]
    return []


def _of_branch(node: ast.AST) -> Edits:
    """A condition that has an operator of its own is left to that."""
    match node:
        case ast.If(test, body, orelse) if not isinstance(test, ast.Compare | ast.UnaryOp):
            return [("boolean negation", ast.If(ast.UnaryOp(ast.Not(), test), body, orelse))]
        case ast.IfExp(test, body, orelse) if not isinstance(test, ast.Compare | ast.UnaryOp):
            return [("boolean negation", ast.IfExp(ast.UnaryOp(ast.Not(), test), body, orelse))]
    return []


def _of_statement(node: ast.AST) -> Edits:
    match node:
        case ast.AugAssign(target, op, value) if type(op) in ARITHMETIC:
            other = ast.AugAssign(target, ARITHMETIC[type(op)](), value)
            return [("arithmetic", other), ("statement deleted", ast.Pass())]
        case ast.Return(ast.expr() as value):
            if isinstance(value, ast.Constant):  # it has an operator of its own
                return []
            return [("return value", ast.Return(ast.Constant(None)))]
        case ast.Expr(ast.Constant()):
            return []
        case ast.Expr() | ast.Assign() | ast.AugAssign() | ast.Raise() | ast.Break():
            return [("statement deleted", ast.Pass())]
        case ast.Return() | ast.Continue():
            return [("statement deleted", ast.Pass())]
    return []


def _compared(left: ast.expr, ops: list[ast.cmpop], comparators: list[ast.expr]) -> Edits:
    """One change for each link of `a <= b < c`."""
    found: Edits = []
    for name, table in (("comparison flipped", OPPOSITE), ("boundary", BESIDE)):
        for i, op in enumerate(ops):
            if type(op) in table:
                changed = [*ops[:i], table[type(op)](), *ops[i + 1 :]]
                found.append((name, ast.Compare(left, changed, comparators)))
    return found


def _other(value: float) -> float:
    """Another number: the next whole one, or twice a fraction."""
    return value + 1 if isinstance(value, int) or value == 0.0 else value * 2


class _Walk(ast.NodeVisitor):
    """Numbers all nodes and remembers of those that may be changed where they stand."""

    def __init__(self) -> None:
        self.nodes: list[tuple[ast.AST, ast.AST | None, str, bool]] = []

    def walk(
        self, node: ast.AST, parent: ast.AST | None, where: str, scope: str, on_import: bool
    ) -> None:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return
        if isinstance(node, ast.expr | ast.stmt):
            self.nodes.append((node, parent, where, on_import))
        for name, child in _children(node):
            inside, around, imported = where, scope, on_import
            if isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef) and name == "body":
                own = getattr(node, "name", "<lambda>")
                around = f"{scope}.{own}" if scope else own
                is_class = isinstance(node, ast.ClassDef)
                imported = on_import if is_class else _compiled(node)
                inside = around if on_import else where  # what is in a function is its own
            self.walk(child, node, inside, around, imported)


def _compiled(node: ast.AST) -> bool:
    return any("jit" in ast.unparse(d) for d in getattr(node, "decorator_list", ()))


def _children(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What may be changed within, and the field it is in."""
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.ClassDef) and any("Protocol" in ast.unparse(b) for b in node.bases):
        return
    if isinstance(node, ast.keyword) and node.arg == "strict":
        return
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns") or (
            isinstance(node, ast.ClassDef) and name == "keywords"
        ):
            continue
        for child in value if isinstance(value, list) else (value,):
            if isinstance(child, ast.AST):
                yield name, child


def _walked(source: str) -> tuple[ast.Module, _Walk]:
    tree, walk = ast.parse(source), _Walk()
    walk.walk(tree, None, MODULE, "", True)
    return tree, walk


def mutants(path: str, home: Path = HOME) -> dict[Mutant, Place]:
    """All of a file, in reading order."""
    _, walk = _walked((home / path).read_text(encoding="utf-8"))
    found: dict[Mutant, Place] = {}
    for number, (node, parent, where, on_import) in enumerate(walk.nodes):
        for k, (operator, other) in enumerate(edits(node, parent)):
            was, becomes = _told(node), _told(other)
            if isinstance(node, ast.Constant) and parent is not None:
                was = f"{was} in {_told(parent)}"
            mutant = Mutant(path, where, operator, was, becomes)
            while mutant in found:
                mutant = msgspec.structs.replace(mutant, nth=mutant.nth + 1)
            line = getattr(node, "lineno", 0)
            found[mutant] = Place(number, k, line, on_import)
    return found


def _told(node: ast.AST) -> str:
    """In one line; of a block, its head."""
    head = ast.unparse(ast.fix_missing_locations(node)).strip().partition("\n")[0]
    return head if len(head) <= MOST_TOLD else head[: MOST_TOLD - 4] + " ..."


def mutated(path: str, place: Place, home: Path = HOME) -> ast.Module:
    """The tree of a file with one place changed; lines stay what they were."""
    tree, walk = _walked((home / path).read_text(encoding="utf-8"))
    node, parent, _, _ = walk.nodes[place.node]
    _, other = edits(node, parent)[place.edit]
    for child in ast.walk(other):
        if not hasattr(child, "lineno"):
            ast.copy_location(child, node)
    ast.copy_location(other, node)
    for name, value in ast.iter_fields(parent) if parent is not None else ():
        if value is node:
            setattr(parent, name, other)
        elif isinstance(value, list) and any(child is node for child in value):
            setattr(parent, name, [other if child is node else child for child in value])
    return ast.fix_missing_locations(tree)
