"""Collects messages from source: what is raised, what is said on standard error, warnings, notes
and reasons for skipping.

A message is its constant text, with … for each part that is formatted into it. A part that is
itself a text of the source, through a name, an argument, an attribute or the return of a function,
is a message of its own.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import jinja2
from jinja2 import nodes

GAP = "…"
WORD = re.compile(r"(?<!\S)\W*(?:[^\W\d_]{2,}|a\b)")
WHOLE = 2
PART = 3
"""What has fewer words, or fewer and is formatted into a message, is a value and nothing to be
looked up."""
TRANSPARENT = ("join", "next", "filter", "format", "str", "tuple", "Counter")
LISTS = ("warnings", "notes", "broken", "hint", "left_out")
COUNTS = ("skipped", "_skipped", "left_out")
Function = ast.FunctionDef | ast.AsyncFunctionDef
COMPREHENSIONS = ast.GeneratorExp | ast.ListComp | ast.SetComp | ast.DictComp


@dataclass
class Source:
    """A module with what its names stand for."""

    name: str
    tree: ast.Module
    functions: dict[str, list[Function]] = field(default_factory=lambda: defaultdict(list))
    values: dict[tuple[ast.AST, str], list[ast.expr]] = field(
        default_factory=lambda: defaultdict(list)
    )
    """By the function, class or module around an assignment and the name: what the name may be."""
    imported: dict[str, str] = field(default_factory=dict)
    """Name here to `module` or `module.name`."""
    around: dict[ast.AST, ast.AST] = field(default_factory=dict)
    """Node to the function, class or module around it."""

    def __post_init__(self) -> None:
        self._enter(self.tree, self.tree)

    def _enter(self, node: ast.AST, scope: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            self.around[child] = scope
            match child:
                case ast.FunctionDef() | ast.AsyncFunctionDef():
                    self.functions[child.name].append(child)
                case ast.ImportFrom(module=str(module)):
                    self.imported |= {
                        alias.asname or alias.name: f"{module}.{alias.name}"
                        for alias in child.names
                    }
                case ast.Assign(value=value):
                    for target in child.targets:
                        self._bind(scope, target, value)
                case (
                    ast.AnnAssign(target=target, value=ast.expr() as value)
                    | ast.AugAssign(target=target, value=value)
                ):
                    self._bind(scope, target, value)
                case ast.NamedExpr(target=target, value=value) | ast.For(target=target, iter=value):
                    self._bind(scope, target, value)
                case ast.comprehension(target=target, iter=value):
                    self._bind(scope, target, value)
                case ast.Call(
                    func=ast.Attribute(value=ast.Name() as target, attr="append" | "extend"),
                    args=[value],
                ):
                    self._bind(scope, target, value)
            self._enter(
                child,
                child if isinstance(child, Function | ast.ClassDef | COMPREHENSIONS) else scope,
            )

    def _bind(self, scope: ast.AST, target: ast.expr, value: ast.expr) -> None:
        match target, value:
            case ast.Tuple(elts=targets), ast.Tuple(elts=values) if len(targets) == len(values):
                for one, of in zip(targets, values, strict=True):
                    self._bind(scope, one, of)
            case ast.Tuple(elts=targets), _:
                for number, one in enumerate(targets):
                    self._bind(scope, one, ast.Subscript(value, ast.Constant(number)))
            case ast.Name(id=name), _:
                self.values[scope, name].append(value)
            case ast.Attribute(value=ast.Name(id="self"), attr=name), _:
                self.values[self.tree, f"self.{name}"].append(value)

    def full_name(self, node: ast.expr) -> str:
        """The full name of what was imported, such as `pipeline.readers.log.table`; empty for
        anything else."""
        match node:
            case ast.Name(id=name):
                return self.imported.get(name, "")
            case ast.Attribute(value=ast.Name(id=name), attr=attr) if name in self.imported:
                return f"{self.imported[name]}.{attr}"
        return ""

    def scopes(self, node: ast.AST) -> Iterator[ast.AST]:
        while node in self.around:
            yield (node := self.around[node])


class Messages:
    """The messages of sources, by module: {"pipeline.core.grid": "…"}."""

    def __init__(self, sources: Mapping[str, str]) -> None:
        self._sources = {name: Source(name, ast.parse(text)) for name, text in sources.items()}
        self._home = {
            node: source for source in self._sources.values() for node in ast.walk(source.tree)
        }
        self._calls: dict[str, list[tuple[Source, ast.Call]]] = defaultdict(list)
        for source in self._sources.values():
            for call in (node for node in ast.walk(source.tree) if isinstance(node, ast.Call)):
                self._calls[_last(call.func)].append((source, call))

    def all(self) -> dict[str, set[str]]:
        """Message to the modules that say it."""
        found: dict[str, set[str]] = defaultdict(set)
        for name, source in self._sources.items():
            for expression in (one for node in ast.walk(source.tree) for one in _told(node)):
                for text, least in self.texts(source, expression, WHOLE, set()):
                    if words(plain := _plain(text)) >= least:
                        found[plain].add(name)
        return dict(found)

    def texts(
        self, source: Source, node: ast.AST, least: int, seen: set[ast.AST]
    ) -> Iterator[tuple[str, int]]:
        """What an expression may be as text, and what may be formatted into it; with each the
        fewest words that count."""
        if node in seen:
            return
        seen.add(node)
        parts: Iterable[ast.AST] = ()
        match node:
            case ast.Constant(value=str(text)):
                yield text, least
            case ast.JoinedStr() | ast.BinOp(op=ast.Add()):
                yield _joined(node), least
                parts = _formatted(node)
                least = PART
            case ast.Subscript(value=ast.Call() as call, slice=ast.Constant(value=int(number))):
                yield from self._call(source, call, least, seen, number)
            case (
                ast.BinOp(op=ast.Mult(), left=part)
                | ast.Subscript(value=part)
                | ast.NamedExpr(value=part)
            ):
                parts = [part]
            case (
                ast.Starred(value=part)
                | ast.GeneratorExp(elt=part)
                | ast.ListComp(elt=part)
                | ast.DictComp(value=part)
            ):
                parts = [part]
            case ast.IfExp():
                parts = [node.body, node.orelse]
            case (
                ast.BoolOp(values=parts)
                | ast.Tuple(elts=parts)
                | ast.List(elts=parts)
                | ast.Set(elts=parts)
            ):
                pass
            case ast.Dict(keys=keys, values=values):
                parts = [*filter(None, keys), *values]
            case ast.Call():
                yield from self._call(source, node, least, seen)
            case ast.Name(id=name):
                yield from self._name(source, node, name, least, seen)
            case ast.Attribute(value=ast.Name(id="self"), attr=name):
                parts = source.values.get((source.tree, f"self.{name}"), ())
        for inner in parts:
            yield from self.texts(source, inner, least, seen)

    def _name(
        self, source: Source, node: ast.AST, name: str, least: int, seen: set[ast.AST]
    ) -> Iterator[tuple[str, int]]:
        for scope in source.scopes(node):
            values = list(source.values.get((scope, name), ()))
            if (
                isinstance(scope, Function) and scope not in seen
            ):  # of one that was called, the arguments are known
                values += self._given(source, scope, name)
            for value in values:
                yield from self.texts(self._home.get(value, source), value, least, seen)

    def _given(self, own: Source, function: Function, name: str) -> Iterator[ast.expr]:
        """What the callers of a function give as one of its arguments."""
        names = [one.arg for one in (*function.args.posonlyargs, *function.args.args)]
        if name not in names:
            return
        at = names.index(name) - (names[0] == "self")
        for source, call in self._calls[function.name]:
            if source.full_name(call.func) == f"{own.name}.{function.name}" or (
                source is own and _plainly(call.func)
            ):
                yield from [one.value for one in call.keywords if one.arg == name] or call.args[
                    at : at + 1
                ]

    def _call(
        self,
        source: Source,
        call: ast.Call,
        least: int,
        seen: set[ast.AST],
        number: int | None = None,
    ) -> Iterator[tuple[str, int]]:
        """What a function of the project returns, or its item of a `number`; of join and the like,
        the text and its arguments."""
        name = _last(call.func)
        full = source.full_name(call.func)
        own = self._sources.get(full.rpartition(".")[0], source)
        within: list[ast.AST] = [call.func.value] if isinstance(call.func, ast.Attribute) else []
        within += (
            call.args
            if name in TRANSPARENT or name in own.functions or name.endswith("Error")
            else []
        )
        for one in within:
            yield from self.texts(source, one, least, seen)
        for function in own.functions.get(name, ()):
            seen.add(function)
            for one in ast.walk(function):
                match one:
                    case ast.Return(value=ast.Tuple(elts=items)) if number is not None:
                        yield from self.texts(own, items[number], least, seen)
                    case (
                        ast.Return(value=ast.expr() as value) | ast.Yield(value=ast.expr() as value)
                    ):
                        yield from self.texts(own, value, least, seen)


def _told(node: ast.AST) -> Iterator[ast.AST]:
    """The expressions of a node that people are shown."""
    match node:
        case ast.Raise(exc=ast.Call() as made):
            yield from made.args
            yield from (one.value for one in made.keywords)
        case ast.Raise(exc=ast.expr() as kept):
            yield kept
        case ast.Call(func=func, args=[*_, text]) if _last(func) in (
            "warn",
            "warn_if",
            "tell",
            "Symptom",
        ):
            yield text
        case ast.Call(func=ast.Name(id="print")) if any(
            ast.unparse(one.value) == "sys.stderr" for one in node.keywords
        ):
            yield from node.args
        case ast.Call(func=ast.Attribute(value=ast.expr() as of, attr="append"), args=[text]) if (
            _last(of) in LISTS
        ):
            yield text
        case ast.Assign(targets=[target], value=value) if _last(target) in LISTS:
            yield value
        case ast.Return(value=ast.Tuple(elts=[*_, ast.Tuple(elts=[ast.JoinedStr(), *_]) as notes])):
            yield notes
        case (
            ast.AugAssign(target=target, value=value) | ast.AnnAssign(target=target, value=value)
        ) if _last(target) in LISTS:
            yield from [value] if value else []
        case ast.keyword(arg="notes" | "warnings", value=value):
            yield value
        case ast.Subscript(value=of, slice=key, ctx=ast.Store()) if _last(of) in COUNTS:
            yield key


def words(text: str) -> int:
    """How many words a text has."""
    return len(WORD.findall(text))


def _last(node: ast.AST) -> str:
    """The last name of `a.b.c`."""
    return (
        node.attr
        if isinstance(node, ast.Attribute)
        else node.id
        if isinstance(node, ast.Name)
        else ""
    )


def _plainly(node: ast.expr) -> bool:
    """Whether a function is called by its name, or as a method of its own object."""
    return isinstance(node, ast.Name) or ast.unparse(node).startswith(("self._", "cls."))


def _joined(node: ast.AST) -> str:
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=values):
            return "".join(map(_joined, values))
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return _joined(left) + _joined(right)
    return GAP


def _formatted(node: ast.AST) -> list[ast.AST]:
    """The parts of a text that are no constants."""
    match node:
        case ast.JoinedStr(values=values):
            return [one.value for one in values if isinstance(one, ast.FormattedValue)]
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return [*_formatted(left), *_formatted(right)]
    return [] if isinstance(node, ast.Constant) else [node]


def _plain(text: str) -> str:
    """One line, with one … for each run of formatted parts."""
    return re.sub(
        rf"{GAP}(?:\s?{GAP})+", GAP, " ".join(re.sub(rf"\{{[^{{}}{GAP}]*\}}", GAP, text).split())
    )


def templated(text: str) -> Iterator[str]:
    """The texts of a Jinja template's branches, such as the doubts of words.yaml; the whole of one
    without branches."""
    tree = jinja2.Environment().parse(text)
    branches = [
        [branch.body for branch in (one, *one.elif_)] + [one.else_]
        for one in tree.find_all(nodes.If)
    ]
    for body in (body for bodies in branches or [[tree.body]] for body in bodies):
        parts = [
            part for output in body if isinstance(output, nodes.Output) for part in output.nodes
        ]
        yield _plain(
            "".join(part.data if isinstance(part, nodes.TemplateData) else GAP for part in parts)
        )
