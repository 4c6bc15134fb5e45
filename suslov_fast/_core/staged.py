"""Parts of loops, with branches and loops of their own, compiled by being read.

A part made `staged` is gone through statement by statement where it is called, with stand-ins for
what is not known beforehand. What is known is done at once: a branch whose condition is `True` or
`False` is taken or left out, and a loop over a tuple is written out. A loop over `range` becomes
one.

What can be read: assignments, `for` over `range` without `break`, `while`, `if`, `continue`, and
one `return`, at the end. Functions that are called are read if they are staged, or formulas, or
else called. What is read means what it means to Python; anything else is `Unreadable`:

names          One that is assigned in several places holds numbers of one type, in memory which
               LLVM takes away again. Any other stands for what it was given, which may be an array
               or a tuple, and is forgotten at the end of the branch or the turn it was given it in.
conditions     are no integers, and integers no conditions.
expressions    What Python would leave out of `a if c else b` and `a < b < c` is computed, and so
               may read, but neither write nor branch. `and` and `or` look at what Python looks at.

What cannot be seen while reading is the caller's to keep: indices and bounds of slices lie within
arrays and count from their beginning, also in what is not chosen of `a if c else b`; integers do
not overflow, and are not divided by 0; a step of `range` that is not known is positive.

All of it is inlined, but for what is made `apart`: LLVM takes longest, and each copy takes as long.

Numba takes ten times as long and longer for each part, before LLVM sees any of it. But here the
source must be at hand, and is read once: modules that are edited and reloaded are not read anew.
"""

import ast
import builtins
import functools
import operator
from collections import ChainMap, Counter
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from llvmlite import ir

from .cache import SOURCES
from .stand_ins import (
    CONDITION,
    EMITTERS,
    Emitted,
    EmittedArray,
    compiled_by,
    emitted,
    loop,
    values_of,
    with_values,
)

_OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.USub: operator.neg,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}
_STAGED = {}


def staged(function):
    """Compile a part of a loop by reading it, as the head of this file says."""
    formula(function)
    compiled_by(function, _STAGED[function], lambda: _returns(function))
    return function


def apart(function):
    """Compile a staged part as a function of its own: once for all its calls, with all registers.

    There is another for other types of its arguments, and for conditions that are known beforehand.
    Numbers are not known in it, but for those in tuples.
    """
    staged(function)
    _STAGED[function] = functools.partial(_call, function)
    return function


def _returns(function):
    tree, _ = _parsed(function)
    return isinstance(tree.body[-1], ast.Return)


def formula(function):
    """Let staged parts read a scalar formula, which stays a Python function for all others.

    Without branches it serves NumPy arrays as it is.
    """
    _STAGED[function] = lambda builder, *arguments: _Reading(builder, function, arguments).result
    return function


def _call(function, builder, *arguments):
    numbers = int, float
    arguments = tuple(emitted(builder, x) if type(x) in numbers else x for x in arguments)
    known = vars(builder.module).setdefault("apart", {})
    called = known.get((function, repr(arguments)))
    if called is None:
        name = builder.module.get_unique_name(f"{function.__qualname__}{arguments}")
        trial = _define(ir.Module(), name, function, arguments, ())
        called = _define(builder.module, name, function, arguments, [*values_of(trial.result)])
        known[function, repr(arguments)] = called
    returned = builder.call(called, [*values_of(arguments)])
    values = (builder.extract_value(returned, k) for k in range(len(returned.type)))
    return with_values(builder, called.result, values)


def _define(module, name, function, arguments, results):
    """A function of LLVM, with what reading it results in; it returns values as `results` are."""
    returned = ir.LiteralStructType([each.type for each in results])
    given = [each.type for each in values_of(arguments)]
    defined = ir.Function(module, ir.FunctionType(returned, given), name)
    defined.linkage = "internal"
    defined.attributes.add("noinline")
    builder = ir.IRBuilder(defined.append_basic_block())
    arguments = with_values(builder, arguments, iter(defined.args))
    defined.result = _Reading(builder, function, arguments).result
    value = ir.Constant(returned, ir.Undefined)
    for k, each in enumerate(values_of(defined.result) if results else ()):
        value = builder.insert_value(value, each, k)
    builder.ret(value)
    return defined


def _pick(compare, builder, first, second):
    """The second of two numbers where it compares so with the first."""
    if isinstance(first, Emitted) or isinstance(second, Emitted):
        return compare(second, first).choose(second, first)
    return second if compare(second, first) else first


_INSTEAD = {
    min: functools.partial(_pick, operator.lt),
    max: functools.partial(_pick, operator.gt),
    int: lambda builder, number: emitted(builder, number).to_integer(),
    np.int8: lambda builder, number: emitted(builder, number).to_integer(),
    np.int64: lambda builder, number: emitted(builder, number).to_integer(),
    np.float64: lambda builder, number: emitted(builder, number).to_double(),
}


class Unreadable(Exception):
    """A part cannot be read; the message says where."""


@functools.cache
def _functions_of(path):
    """The syntax trees of the functions of a file, by their first lines."""
    try:
        source = SOURCES.get(path) or Path(path).read_bytes()
    except OSError as error:
        raise Unreadable(f"the source of {path} is needed, and is not at hand") from error
    tree = ast.parse(source)
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    return {min(each.lineno for each in (node, *node.decorator_list)): node for node in functions}


@functools.cache
def _parsed(function):
    """The syntax tree of a function, and the names that are assigned in several places.

    All loops whose index has a name are one place: none sees the index of another.
    """
    code = function.__code__
    tree = _functions_of(code.co_filename).get(code.co_firstlineno)
    if tree is None or tree.name != code.co_name:
        raise Unreadable(f"{code.co_name} is not in {code.co_filename} where it was")
    counts = Counter(each.arg for each in tree.args.args)
    of_loops = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            counts.update(name for target in node.targets for name in _stored(target))
        elif isinstance(node, ast.AugAssign):
            counts.update(2 * _stored(node.target))
        elif isinstance(node, ast.For):
            of_loops.update(_stored(node.target))
    counts.update(of_loops)
    return tree, frozenset(name for name, count in counts.items() if count > 1)


def _stored(target):
    """The names that an assignment to a target gives a value."""
    names = (each for each in ast.walk(target) if isinstance(each, ast.Name))
    return [each.id for each in names if isinstance(each.ctx, ast.Store)]


class _Variable:
    """The memory of the numbers that a varying name is given one after the other."""

    def __init__(self, builder, value):
        self.builder = builder
        with builder.goto_entry_block():
            self.place = builder.alloca(value.type)

    def set(self, value):
        self.builder.store(value, self.place)

    def get(self):
        return Emitted(self.builder, self.builder.load(self.place))


def _writes(instruction):
    """Whether others see what an instruction does: only the memory of a name is an `alloca`."""
    if instruction.opname == "store":
        return getattr(instruction.operands[1], "opname", None) != "alloca"
    return instruction.opname == "fence"


class _Reading:
    """One passage through a function; methods are named after the nodes that they are for.

    known     what names outside the function stand for.
    names     what names of the function stand for: a `_Variable` for those that are `varying`.
    again     where a `continue` goes, the innermost loop last.
    result    what the function returns.
    """

    def __init__(self, builder, function, arguments):
        tree, self.varying = _parsed(function)
        self.builder, self.again = builder, []
        self.code = function.__code__
        free = (cell.cell_contents for cell in function.__closure__ or ())
        held = dict(zip(function.__code__.co_freevars, free, strict=True))
        self.known = ChainMap(held, function.__globals__, vars(builtins))
        self.names = {}
        for parameter, value in zip(tree.args.args, arguments, strict=True):
            self.set_name(parameter.arg, value)
        *statements, last = tree.body
        self.result = None
        self.do(statements)
        if isinstance(last, ast.Return):
            with self.told(last):
                self.result = self.value(last.value)
        else:
            self.do([last])

    @contextmanager
    def told(self, statement):
        """Say where an error is."""
        try:
            yield
        except Unreadable:
            raise
        except Exception as error:
            where = f"{self.code.co_filename}, line {statement.lineno}, in {self.code.co_name}"
            raise Unreadable(f"{where}: {type(error).__name__}: {error}") from error

    def do(self, statements):
        for each in statements:
            if self.builder.block.is_terminated:  # by a `continue`
                return
            with self.told(each):
                self.value(each)

    def value(self, node):
        """What an expression is, or None for a statement that is done."""
        kind = type(node).__name__
        read = getattr(self, kind, None)
        if read is None:
            raise NotImplementedError(f"{kind} cannot be read")
        return read(node)

    def condition(self, node):
        """What is known of a condition, or a stand-in for one."""
        value = self.value(node)
        if isinstance(value, Emitted) and value.value.type != CONDITION:
            raise TypeError(f"{ast.unparse(node)} is not a condition")
        return value

    @contextmanager
    def perhaps(self):
        """What is done once, several times, or not at all: only varying names keep values."""
        before = self.names.copy()
        yield
        self.names = {
            name: value
            for name, value in self.names.items()
            if isinstance(value, _Variable) or (name in before and value is before[name])
        }

    # Statements.

    def Expr(self, node):
        self.value(node.value)

    def Assign(self, node):
        (target,) = node.targets
        self.set(target, self.value(node.value))

    def AugAssign(self, node):
        target = node.target
        if isinstance(target, ast.Name):
            old = self.Name(target)
            self.set_name(target.id, self.operate(node.op, old, self.value(node.value)))
        else:
            array, index = self.place(target)
            array[index] = self.operate(node.op, array[index], self.value(node.value))

    def set(self, target, value):
        if isinstance(target, ast.Name):
            self.set_name(target.id, value)
        elif isinstance(target, ast.Subscript):
            array, index = self.place(target)
            array[index] = value
        elif isinstance(target, ast.Tuple):
            for each, part in zip(target.elts, value, strict=True):
                self.set(each, part)
        else:
            raise NotImplementedError(f"{ast.unparse(target)} cannot be given a value")

    def place(self, target):
        """An array and an index. What is no argument of a loop would be written to only once."""
        array = self.value(target.value)
        if not isinstance(array, EmittedArray):
            raise TypeError(f"{ast.unparse(target.value)} is not an array of the loop")
        return array, self.value(target.slice)

    def set_name(self, name, value):
        if name == "_":
            return
        if name in self.varying:
            value = emitted(self.builder, value).value
            if name not in self.names:
                self.names[name] = _Variable(self.builder, value)
            self.names[name].set(value)
        else:
            self.names[name] = value

    def For(self, node):
        call = node.iter
        self.no_else(node)
        if isinstance(call, ast.Call) and self.value(call.func) is range:
            bounds = [self.value(each) for each in call.args]
            if len(bounds) == 1:
                bounds = [0, *bounds]
            values = loop(self.builder, *bounds[:2], *(bounds[2:] or [1]))
        else:
            values = self.value(call)
        for value in values:
            with self.perhaps():
                self.set(node.target, value)
                self.repeat(node.body)

    def no_else(self, node):
        if node.orelse:
            raise NotImplementedError("the `else` of a loop cannot be read")

    def repeat(self, statements):
        """Do what is repeated, of which a `continue` ends one turn."""
        end = self.builder.append_basic_block()
        self.again.append(end)
        with self.perhaps():
            self.do(statements)
        self.again.pop()
        self.go_to(end)
        self.builder.position_at_end(end)

    def go_to(self, block):
        if not self.builder.block.is_terminated:
            self.builder.branch(block)

    def Continue(self, node):
        self.builder.branch(self.again[-1])

    def While(self, node):
        self.no_else(node)
        test, body, after = (self.builder.append_basic_block() for _ in range(3))
        self.builder.branch(test)
        self.builder.position_at_end(test)
        condition = emitted(self.builder, self.condition(node.test)).value
        self.builder.cbranch(condition, body, after)
        self.builder.position_at_end(body)
        self.repeat(node.body)
        self.builder.branch(test)
        self.builder.position_at_end(after)

    def If(self, node):
        condition = self.condition(node.test)
        if not isinstance(condition, Emitted):
            self.do(node.body if condition else node.orelse)
            return
        then, otherwise, after = (self.builder.append_basic_block() for _ in range(3))
        self.builder.cbranch(condition.value, then, otherwise)
        for block, statements in ((then, node.body), (otherwise, node.orelse)):
            self.builder.position_at_end(block)
            with self.perhaps():
                self.do(statements)
            self.go_to(after)
        self.builder.position_at_end(after)

    # Expressions.

    def Constant(self, node):
        return node.value

    def Name(self, node):
        if node.id in self.names:
            value = self.names[node.id]
            return value.get() if isinstance(value, _Variable) else value
        if node.id in self.code.co_varnames:
            raise NameError(f"{node.id} has no value here, or only by a branch or a loop")
        if node.id not in self.known:
            raise NameError(f"{node.id} is not defined")
        return self.known[node.id]

    def Attribute(self, node):
        return getattr(self.value(node.value), node.attr)

    def Tuple(self, node):
        return tuple(self.values(node.elts))

    def values(self, nodes):
        for node in nodes:
            if isinstance(node, ast.Starred):
                yield from self.value(node.value)
            else:
                yield self.value(node)

    def operate(self, operation, *values):
        return _OPERATORS[type(operation)](*values)

    def BinOp(self, node):
        return self.operate(node.op, self.value(node.left), self.value(node.right))

    def UnaryOp(self, node):
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return ~value if isinstance(value, Emitted) else not value
        return self.operate(node.op, value)

    def Compare(self, node):
        values = [self.value(node.left), self.value(node.comparators[0])]
        with self.harmless():
            values += [self.value(each) for each in node.comparators[1:]]
        results = map(self.operate, node.ops, values, values[1:])
        return functools.reduce(operator.and_, results)

    def BoolOp(self, node):
        """What need not be known is not looked at."""
        first, *others = node.values
        value = self.condition(first)
        for other in others:
            decided = isinstance(node.op, ast.Or)
            if not isinstance(value, Emitted):
                value = value if bool(value) is decided else self.condition(other)
                continue
            found = _Variable(self.builder, value.value)
            found.set(value.value)
            look, after = (self.builder.append_basic_block() for _ in range(2))
            self.builder.cbranch(value.value, *((after, look) if decided else (look, after)))
            self.builder.position_at_end(look)
            found.set(emitted(self.builder, self.condition(other)).value)
            self.builder.branch(after)
            self.builder.position_at_end(after)
            value = found.get()
        return value

    def IfExp(self, node):
        condition = self.condition(node.test)
        if not isinstance(condition, Emitted):
            return self.value(node.body if condition else node.orelse)
        with self.harmless():
            return condition.choose(self.value(node.body), self.value(node.orelse))

    @contextmanager
    def harmless(self):
        """What Python might leave out is computed: nothing else may happen there."""
        block, begin = self.builder.block, len(self.builder.block.instructions)
        yield
        if self.builder.block is not block or any(map(_writes, block.instructions[begin:])):
            raise NotImplementedError("what may be left out branches, or writes to an array")

    def Subscript(self, node):
        return self.value(node.value)[self.value(node.slice)]

    def Slice(self, node):
        bounds = node.lower, node.upper, node.step
        return slice(*(each and self.value(each) for each in bounds))

    def Call(self, node):
        function = self.value(node.func)
        arguments = list(self.values(node.args))
        named = {each.arg: self.value(each.value) for each in node.keywords}
        for known in (_STAGED, EMITTERS, _INSTEAD):
            if function in known:
                return known[function](self.builder, *arguments, **named)
        return function(*arguments, **named)
