"""A Python plan with threads, as SMART-LLM has models write it, read into a plan graph; nothing of it is ever run.

The syntax tree is walked as the program would run: a skill waits for what its thread has done before, a started thread
for what had been done by then, and after `join` the caller waits for the thread as well.
"""

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from muster_schemas.plan import MAX_TASKS, InstructionFunction, Plan, PlanTask
from muster_schemas.skills import Catalogue, Skill

Done = frozenset[str]
"""Names of the tasks that something waits for."""

_MAX_DEPTH = 20
_MAX_STEPS = 5_000
_NOTHING = frozenset({"print", "sleep"})
"""Calls that do nothing to a plan."""


class PlanCodeError(ValueError):
    """A program that is no plan; the message says which line and why."""

    def __init__(self, node: ast.AST, why: str) -> None:
        super().__init__(f"line {getattr(node, 'lineno', 1)}: {why}")


@dataclass(frozen=True)
class _Group:
    """Robots by type: `robots_of("dump_truck", 2)`."""

    robot_type: str
    count: int | None


@dataclass
class _Thread:
    """A thread of the program; what it has done is known once it is started."""

    call: ast.Call
    target: object
    arguments: Sequence[object]
    done: Done | None = None


@dataclass
class _Frame:
    """One call of a function: its names, and what has been done when its next line runs."""

    names: dict[str, object]
    done: Done
    depth: int = 0
    returned: bool = False

    def knowing(self, name: str, value: object) -> "_Frame":
        """Return this frame with a name bound."""
        self.names[name] = value
        return self


@dataclass
class _Reader:
    catalogue: Catalogue
    tasks: list[PlanTask] = field(default_factory=list[PlanTask])
    steps: int = 0

    # Statements

    def run(self, body: Iterable[ast.stmt], frame: _Frame) -> None:
        for statement in body:
            if frame.returned:
                return
            self.steps += 1
            if self.steps > _MAX_STEPS:
                raise PlanCodeError(statement, "the program is too long")
            self.statement(statement, frame)

    def statement(self, node: ast.stmt, frame: _Frame) -> None:
        match node:
            case ast.FunctionDef():
                frame.names[node.name] = node
            case ast.Import() | ast.ImportFrom() | ast.Pass():
                pass
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr(value=value):
                self.value(value, frame)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                frame.names[name] = self.value(value, frame)
            case ast.For(target=ast.Name(id=name), iter=items, orelse=[]):
                for item in self.items(items, frame):
                    frame.names[name] = item
                    self.run(node.body, frame)
            case ast.If(test=ast.Compare(left=ast.Name(id="__name__")), orelse=[]):
                self.run(node.body, frame)
            case ast.Return():
                if node.value is not None:
                    self.value(node.value, frame)
                frame.returned = True
            case _:
                raise PlanCodeError(node, f"a plan has no {type(node).__name__.lower()}")

    # Values

    def value(self, node: ast.expr, frame: _Frame) -> object:  # noqa: PLR0911 (one for each kind of expression)
        self.steps += 1
        if self.steps > _MAX_STEPS:
            raise PlanCodeError(node, "the program is too long")
        match node:
            case ast.Constant(value=str() | int() | float() | None as constant):
                return constant
            case ast.Name(id=name) if name in frame.names:
                return frame.names[name]
            case ast.Name(id=name) if name in self.catalogue:
                return self.catalogue[name]
            case ast.Name(id=name):
                raise PlanCodeError(node, f"there is no {name!r}")
            case ast.List() | ast.Tuple():
                return [self.value(item, frame) for item in node.elts]
            case ast.ListComp(generators=[ast.comprehension(target=ast.Name(id=name), ifs=[]) as loop]):
                return [self.value(node.elt, frame.knowing(name, item)) for item in self.items(loop.iter, frame)]
            case ast.Lambda():
                return node
            case ast.Call():
                return self.call(node, frame)
            case _:
                raise PlanCodeError(node, f"a plan has no {type(node).__name__.lower()}")

    def items(self, node: ast.expr, frame: _Frame) -> list[object]:
        value = self.value(node, frame)
        if not isinstance(value, list):
            raise PlanCodeError(node, "a loop goes over a list")
        return list(cast("list[object]", value))

    # Calls

    def call(self, node: ast.Call, frame: _Frame) -> object:
        match node.func:
            case ast.Attribute(attr="Thread") | ast.Name(id="Thread"):
                return self.thread(node, frame)
            case ast.Attribute(value=owner, attr="append"):
                held = self.value(owner, frame)
                if not isinstance(held, list):
                    raise PlanCodeError(node, "only a list has append()")
                cast("list[object]", held).extend(self.value(a, frame) for a in node.args)
            case ast.Attribute(value=owner, attr=("start" | "join") as what):
                thread = self.value(owner, frame)
                if not isinstance(thread, _Thread):
                    raise PlanCodeError(node, f"only a thread has {what}()")
                self.start(thread, frame) if what == "start" else self.join(thread, frame)
            case ast.Attribute(attr=name) | ast.Name(id=name) if name in _NOTHING:
                pass
            case ast.Name(id="robots_of"):
                return self.group(node, frame)
            case ast.Name():
                arguments = [self.value(a, frame) for a in node.args]
                keywords = {k.arg: self.value(k.value, frame) for k in node.keywords if k.arg}
                frame.done = self.enter(self.value(node.func, frame), node, arguments, keywords, frame)
            case _:
                raise PlanCodeError(node, "only skills, functions of the plan and threads can be called")
        return None

    def enter(
        self, what: object, node: ast.Call, arguments: Sequence[object], keywords: Mapping[str, object], frame: _Frame
    ) -> Done:
        """Walk through a skill or function called here; return what has been done at its end."""
        if isinstance(what, Skill):
            return self.skill(what, node, arguments, keywords, frame)
        if not isinstance(what, ast.FunctionDef | ast.Lambda):
            raise PlanCodeError(node, "only a skill or a function can be called")
        if frame.depth >= _MAX_DEPTH:
            raise PlanCodeError(node, "functions call each other too deeply")
        parameters = [a.arg for a in what.args.args]
        given = {**dict(zip(parameters, arguments, strict=False)), **keywords}
        for parameter, default in zip(reversed(parameters), reversed(what.args.defaults), strict=False):
            if parameter not in given:
                given[parameter] = self.value(default, frame)
        if len(arguments) > len(parameters) or set(given) != set(parameters):
            raise PlanCodeError(node, f"the function takes {', '.join(parameters) or 'nothing'}")
        inner = _Frame({**frame.names, **given}, frame.done, frame.depth + 1)
        if isinstance(what, ast.Lambda):
            self.value(what.body, inner)
        else:
            self.run(what.body, inner)
        return inner.done

    def thread(self, node: ast.Call, frame: _Frame) -> _Thread:
        given = {k.arg: k.value for k in node.keywords if k.arg}
        if "target" not in given:
            raise PlanCodeError(node, "a thread needs target=")
        arguments = self.items(given["args"], frame) if "args" in given else []
        return _Thread(node, self.value(given["target"], frame), arguments)

    def start(self, thread: _Thread, frame: _Frame) -> None:
        if thread.done is not None:
            raise PlanCodeError(thread.call, "a thread can be started once")
        thread.done = self.enter(thread.target, thread.call, thread.arguments, {}, frame)

    def join(self, thread: _Thread, frame: _Frame) -> None:
        if thread.done is None:
            raise PlanCodeError(thread.call, "a thread is joined before it is started")
        frame.done |= thread.done

    def group(self, node: ast.Call, frame: _Frame) -> _Group:
        match [self.value(a, frame) for a in node.args]:
            case [str() as robot_type]:
                return _Group(robot_type, None)
            case [str() as robot_type, int() as count]:
                return _Group(robot_type, count)
            case _:
                raise PlanCodeError(node, "robots_of takes a type, and how many if not all")

    # Skills

    def skill(
        self,
        skill: Skill,
        node: ast.Call,
        arguments: Sequence[object],
        keywords: Mapping[str, object],
        frame: _Frame,
    ) -> Done:
        if len(self.tasks) >= MAX_TASKS:
            raise PlanCodeError(node, f"a plan has at most {MAX_TASKS} tasks")
        parameters = ("objects",) if skill.fleet_wide else ("robots", "objects")
        given = {**dict(zip(parameters, arguments, strict=False)), **keywords}
        if len(arguments) > len(parameters) or set(given) - set(parameters):
            raise PlanCodeError(node, f"{skill.name} takes {' and '.join(parameters)}")
        name = f"{skill.name}_{len(self.tasks) + 1}"
        fields = {
            "name": skill.aliases[0] if skill.aliases else skill.name,
            **_who(given.get("robots"), node),
            "dependencies": sorted(frame.done),
            "object_keywords": _names(given.get("objects"), node),
        }
        try:
            function = InstructionFunction.model_validate(fields)
        except ValueError as error:
            raise PlanCodeError(node, f"{skill.name} cannot be done with these arguments") from error
        self.tasks.append(PlanTask(task=name, instruction_function=function))
        return frozenset({name})


def _who(said: object, node: ast.AST) -> dict[str, object]:
    if isinstance(said, _Group):
        return {"robot_type": [said.robot_type], "robot_count": said.count or "all"}
    return {"robot_ids": _names(said, node)}


def _names(said: object, node: ast.AST) -> list[str]:
    """Return the names in an argument: one, some, or none."""
    listed: list[object] = cast("list[object]", said) if isinstance(said, list) else [] if said is None else [said]
    names = [n for n in listed if isinstance(n, str)]
    if len(names) < len(listed):
        raise PlanCodeError(node, "robots and objects are named by strings")
    return names


def read_program(program: str, catalogue: Catalogue) -> Plan:
    """Return the plan that a program means.

    Raises:
        PlanCodeError: it is no Python, or does what a plan cannot.

    """
    try:
        tree = ast.parse(program)
        reader = _Reader(catalogue)
        reader.run(tree.body, _Frame({}, frozenset()))
    except SyntaxError as error:
        raise PlanCodeError(ast.Pass(lineno=error.lineno or 1), "it is no Python") from error
    except (RecursionError, MemoryError, ValueError) as error:
        if isinstance(error, PlanCodeError):
            raise
        raise PlanCodeError(ast.Pass(lineno=1), "it is nested too deeply, or no text of a program") from error
    if not reader.tasks:
        raise PlanCodeError(ast.Pass(lineno=1), "it uses no skill")
    return Plan(tasks=tuple(reader.tasks))
