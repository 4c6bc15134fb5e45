"""The names with which a user's function is called with symbols.

The function, and each Python function that it reaches by its names, run as copies. In their names,
and in what these lead to, such as modules, methods and lists, functions of NumPy, `math` and
`cmath`, tables of SciPy and some built-in functions are exchanged for those that take symbols, too.
Functions of NumPy, SciPy, Numba, the standard library and this package run as they are. Nothing
that others can see changes: modules, classes and objects stay as they are.
"""

from __future__ import annotations

import builtins
import functools
import sys
from abc import ABCMeta
from collections.abc import Callable
from types import CellType, CodeType, FunctionType, MethodType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from .scipy_tables import at_symbols, is_table
from .script_functions import (
    IN_PLACE,
    IN_PLACE_FILLING_ALL,
    OF_BUILTINS,
    either,
    entry_by_entry,
    of_scipy,
    taking_lists,
)
from .symbols import Symbols
from .tolerances import MOST_ENTRIES

_KEPT = {*sys.stdlib_module_names, "numpy", "scipy", "numba", "suslov_fast"} - {"__main__"}
_PLAIN = {float, int, complex, str, bool, bytes, type(None), type, np.ndarray, np.float64}
_OF_PYTHON = 1 << 9  # the flag of classes that are made by Python code
_CACHED = type(functools.lru_cache(lambda: None))


def _is_kept(module: Any) -> bool:
    return str(module).partition(".")[0] in _KEPT


class _View:
    """A module, or a namespace, whose names lead to what f finds in their place."""

    def __init__(self, of: Any, names: Names) -> None:
        vars(self).update(_of=of, _names=names)

    def __getattr__(self, name: str) -> Any:
        return self._names.of(getattr(self._of, name))

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._of, name, value)


class _Table(_View):
    """A table of SciPy that takes numbers and symbols."""

    def __call__(self, t: Any, *given: Any, **options: Any) -> Any:
        return at_symbols(self._of, t, *given, **options)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._of, name)
        if not callable(value):
            return value
        return lambda *given, **options: self._names.of(value(*given, **options))


class Names:
    """What a function, and those that it reaches, find by their names; a copy is made once."""

    def __init__(self, fills_all: bool = False) -> None:
        self._known: dict[int, tuple[Any, Any]] = {}  # by id: the object, which lives, and ours
        self._spaces: dict[int, dict[str, Any]] = {}  # ours, by the id of the global names
        self._classes: dict[Any, Any] = {}
        self._fills_all = fills_all
        self._exchanged = IN_PLACE_FILLING_ALL if fills_all else IN_PLACE
        self._builtins = {**vars(builtins), **OF_BUILTINS}
        self._builtins |= {"__import__": self._imported, "super": self._super}
        self._makers: dict[Any, Callable[[Any], Any]] = {
            MethodType: self._method,
            ModuleType: self._view,
            SimpleNamespace: self._view,
            functools.partial: self._partial,
            np.vectorize: lambda f: self._keep(f, either(f, entry_by_entry(self.of(f.pyfunc)))),
            _CACHED: lambda f: self._keep(f, self.of(f.__wrapped__)),
            list: self._entries,
            tuple: self._entries,
            dict: self._entries,
        }

    def of(self, value: Any) -> Any:
        """Return what f finds in place of a value."""
        make = self._maker(value)
        return value if make is None else make(value)

    def copy_of(self, f: Any) -> Any:
        """Return what is called in place of f."""
        return self._function(f) if type(f) is FunctionType else self.of(f)

    def close(self) -> None:
        """Forget all copies, so that they need no garbage collection."""
        for each in (self._known, self._spaces, self._classes, self._makers):
            each.clear()
        self._builtins = {}

    def _keep(self, value: Any, ours: Any) -> Any:
        self._known[id(value)] = value, ours
        return ours

    def _maker(self, value: Any) -> Callable[[Any], Any] | None:
        """Return the function that makes what f finds in place of a value; None for itself."""
        kind = type(value)
        known = self._exchanged.get(id(value)) or self._known.get(id(value))
        if known is not None:
            return lambda _: known[1]
        if kind is np.ndarray and self._fills_all and value.dtype.char in "dD":
            return lambda value: self._keep(value, value.astype(object).view(Symbols))
        if kind in _PLAIN:
            return None
        if kind in self._makers:
            return self._makers[kind]
        if (found := of_scipy(value)) is not None:
            return lambda value: self._keep(value, found)
        if kind is FunctionType:
            return None if _is_kept(value.__globals__.get("__name__")) else self._function
        if (found := taking_lists(value)) is not None:
            return lambda value: self._keep(value, found)
        if is_table(value):
            return lambda value: self._keep(value, _Table(value, self))
        if kind.__module__.startswith("numba."):
            plain = getattr(value, "py_func", None)
            return None if plain is None else lambda _: self._function(plain)
        return self._object if self._is_of_users(value, kind) else None

    # ------------------------------------------------------------------------------ functions
    def _function(self, f: Any) -> Any:
        """Return the copy of a Python function."""
        if (known := self._known.get(id(f))) is not None:
            return known[1]
        old, code = f.__globals__, f.__code__
        if (new := self._spaces.get(id(old))) is None:
            new = self._spaces[id(old)] = {**old, "__builtins__": self._builtins}
        cells = [(cell, self._cell(cell)) for cell in f.__closure__ or ()]
        ours = FunctionType(code, new, f.__name__, None, tuple(b for _, b in cells) or None)
        self._keep(f, ours)  # before its names are read, of which one may be f
        ours.__dict__, ours.__qualname__ = f.__dict__, f.__qualname__
        ours.__defaults__ = f.__defaults__ and tuple(map(self.of, f.__defaults__))
        ours.__kwdefaults__ = f.__kwdefaults__ and self.of(f.__kwdefaults__)
        for name in _names_in(code):
            if name in old and new.get(name) is old[name]:
                new[name] = self.of(old[name])
        for cell, other in cells:
            if other is not cell and _is_empty(other):
                other.cell_contents = self.of(cell.cell_contents)
        return ours

    def _cell(self, cell: CellType) -> CellType:
        """Return the cell itself if f finds the same value there, else a new, empty one."""
        if (known := self._known.get(id(cell))) is not None:
            return known[1]
        is_same = _is_empty(cell) or self._maker(cell.cell_contents) is None
        return self._keep(cell, cell if is_same else CellType())

    def _partial(self, f: Any) -> Any:
        options = {name: self.of(value) for name, value in f.keywords.items()}
        return functools.partial(self.copy_of(f.func), *map(self.of, f.args), **options)

    def _method(self, f: Any) -> Any:
        function = self.of(f.__func__)
        return f if function is f.__func__ else MethodType(function, self.of(f.__self__))

    def _imported(self, *given: Any, **options: Any) -> Any:
        return self.of(builtins.__import__(*given, **options))

    def _super(self, *given: Any) -> Any:
        if not given:  # as Python does, from the frame of the caller
            frame = sys._getframe(1)
            names = frame.f_locals
            given = names["__class__"], names[frame.f_code.co_varnames[0]]
        return _View(super(*given), self)

    # ------------------------------------------------------------------------------ objects
    def _view(self, value: Any) -> Any:
        return self._keep(value, _View(value, self))

    def _entries(self, value: Any) -> Any:
        """Return a list, tuple or dictionary of what f finds in place of its entries."""
        if len(value) > MOST_ENTRIES:
            return value
        self._keep(value, value)  # it may contain itself
        old = [*value.values()] if isinstance(value, dict) else value
        new = [*map(self.of, old)]
        del self._known[id(value)]  # it may change
        if all(a is b for a, b in zip(old, new, strict=True)):
            return value
        return dict(zip(value, new, strict=True)) if isinstance(value, dict) else type(value)(new)

    def _is_of_users(self, value: Any, kind: Any) -> bool:
        """Return True for an object of a user's class, whose attributes are in a dictionary."""
        is_plain = type(kind) in (type, ABCMeta) and kind.__flags__ & _OF_PYTHON
        is_new = is_plain and kind not in self._classes.values() and not _is_kept(kind.__module__)
        makes_more = any("__init_subclass__" in vars(each) for each in kind.__mro__[:-1])
        return bool(is_new and not makes_more and isinstance(getattr(value, "__dict__", 0), dict))

    def _object(self, value: Any) -> Any:
        """Return an object with the attributes of a user's one, which it does not change."""
        kind: Any = type(value)
        if kind not in self._classes:

            def found(this: Any, name: str) -> Any:
                if isinstance(of_class := getattr(kind, name, None), property) and of_class.fget:
                    return self.of(self.of(of_class.fget)(this))
                attribute = kind.__getattribute__(this, name)
                return attribute if name.startswith("__") else self.of(attribute)

            def called(this: Any, *given: Any, **options: Any) -> Any:
                return self.of(MethodType(kind.__call__, this))(*given, **options)

            parts: dict[str, Any] = {"__getattribute__": found, "__slots__": ()}
            parts["__class__"] = property(lambda _: kind)
            if hasattr(kind, "__call__"):  # noqa: B004
                parts["__call__"] = called
            make: Any = type(kind)
            self._classes[kind] = make(kind.__name__, (kind,), parts)
        try:
            ours = object.__new__(self._classes[kind])
        except TypeError:  # of a class that inherits from a type such as `dict`
            return self._keep(value, value)
        object.__setattr__(ours, "__dict__", {**value.__dict__})
        return self._keep(value, ours)


def is_copied(frame: Any) -> bool:
    """Return True for a frame of a function that is a copy."""
    return bool(frame.f_builtins.get("isinstance") is OF_BUILTINS["isinstance"])


def _names_in(code: CodeType) -> set[str]:
    """Return the names that a function reads, and that functions in it read."""
    names = set(code.co_names)
    for each in code.co_consts:
        if type(each) is CodeType:
            names |= _names_in(each)
    return names


def _is_empty(cell: CellType) -> bool:
    try:
        _ = cell.cell_contents
    except ValueError:
        return True
    return False
