"""Text in LLVM's language, and its machine code.

LLVM forms no FMA and keeps the order of operations. Compiling takes 0.3 to 0.5 ms an operation.
Machine code stays until the process ends, since addresses of it may be anywhere. Addresses in the
text are integers: versions of LLVM write the types of pointers differently.
"""

import ctypes
import itertools
import os
import threading
import warnings

import numpy as np
from llvmlite import binding
from numba import config

from .operations import OF_TRUTH

MANY = 6000  # operations, above which optimising takes longer than it mostly saves
LARGE = 40_000  # operations, above which one function needs too much memory of the stack


def pointer(kind):
    """Return the type of an address of this type, as this version of LLVM writes it."""
    return "ptr" if binding.llvm_version_info[0] > 16 else f"{kind}*"


class Text:
    """Text of a function, for lines of W lanes."""

    def __init__(self, W, of=None):
        self.W, self.of = W, of or self
        self.lines, self.count = [], 0
        self.V = f"<{W} x double>" if W > 1 else "double"
        self.M = f"<{W} x i1>" if W > 1 else "i1"
        self.suffix = f"v{W}f64" if W > 1 else "f64"

    def add(self, line):
        self.of.lines.append(line)

    def new(self, text):
        """Add an instruction; return the name of its value."""
        self.of.count += 1
        self.of.lines.append(f"  %v{self.of.count} = {text}")
        return f"%v{self.of.count}"

    def label(self, name):
        self.lines.append(f"{name}:")

    def each(self, constant):
        """Return a line of equal constants."""
        number = f"double 0x{np.float64(constant).view(np.uint64):016X}"
        return number.split()[1] if self.W == 1 else f"<{', '.join([number] * self.W)}>"

    def load(self, kind, address, align=8):
        place = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        return self.new(f"load {kind}, {pointer(kind)} {place}, align {align}")

    def store(self, kind, value, address, align=8, mark=""):
        place = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        self.add(f"  store {kind} {value}, {pointer(kind)} {place}, align {align}{mark}")

    def integer(self, instruction, a, b):
        return self.new(f"{instruction} i64 {a}, {b}")

    def plus(self, address, offset):
        return self.integer("add", address, offset) if offset else address

    def operate(self, instruction, a, b):
        return self.new(f"{instruction} {self.V} {a}, {b}")

    def test(self, how, a, b):
        return self.new(f"fcmp {how} {self.V} {a}, {b}")

    def choose_line(self, truth, a, b):
        return self.new(f"select {self.M} {truth}, {self.V} {a}, {self.V} {b}")

    def joined(self, instruction, truths):
        first, *others = truths
        for each in others:
            first = self.new(f"{instruction} {self.M} {first}, {each}")
        return first

    def splat(self, number, W):
        """Return a vector of W equal numbers."""
        kind = f"<{W} x double>"
        one = self.new(f"insertelement {kind} undef, double {number}, i32 0")
        return self.new(f"shufflevector {kind} {one}, {kind} undef, <{W} x i32> zeroinitializer")

    def compare(self, how, a, b):
        return self.new(f"icmp {how} i64 {a}, {b}")

    def choose(self, truth, a, b):
        return self.new(f"select i1 {truth}, i64 {a}, i64 {b}")

    def all_true(self, truth):
        """Return whether a line of truth values are all true."""
        if self.W == 1:
            return truth
        truth = self.new(f"bitcast {self.M} {truth} to i{self.W}")
        return self.new(f"icmp eq i{self.W} {truth}, -1")

    def bits(self, truth):
        """Return the truth values of a line as an integer."""
        if self.W > 1:
            truth = self.new(f"bitcast {self.M} {truth} to i{self.W}")
        return self.new(f"zext i{self.W} {truth} to i64")

    def whole(self):
        """Return the text, with what it needs."""
        return "\n".join([
            *self.lines, "}",
            f"declare {self.V} @llvm.fabs.{self.suffix}({self.V})",
            f"declare {self.V} @llvm.sqrt.{self.suffix}({self.V})",
            # Lines are whole registers also where LLVM prefers narrower ones.
            'attributes #0 = { nounwind "min-legal-vector-width"="512" }',
            '!0 = !{!"branch_weights", i32 1000000, i32 1}', "!1 = !{i32 1}", "",
        ])  # fmt: skip

    def carry_out(self, operations, values, get):
        """Add operations; `get` returns the name of a value that is not in `values`."""
        V, M = self.V, self.M
        for instruction, number, operands in operations:
            names = []
            for each in operands:
                if not isinstance(each, float) and each not in values:
                    values[each] = get(each)
                names.append(self.each(each) if isinstance(each, float) else values[each])
            both = ", ".join(names)
            if instruction == "fabs":
                name = self.new(f"call {V} @llvm.fabs.{self.suffix}({V} {both})")
            elif instruction in ("larger", "lesser"):
                code = "ogt" if instruction == "larger" else "olt"
                name = self.new(f"fcmp {code} {V} {both}")
                name = self.new(f"select {M} {name}, {V} {names[0]}, {V} {names[1]}")
            elif instruction == "select":
                name = self.new(f"select {M} {names[0]}, {V} {names[1]}, {V} {names[2]}")
            elif instruction in ("and", "or", "xor"):
                name = self.new(f"{instruction} {M} {both}")
            elif instruction in OF_TRUTH:
                name = self.test(instruction, *names)
            else:
                name = self.operate(instruction, *names)
            values[number] = name


# ------------------------------------------------------------------------------------------ compile
_codes = {}  # addresses, by what the code is for
_engines = {}  # by levels of optimisation
_numbers = itertools.count()  # of names, of which no two are the same, also after Ctrl-C
_lock = threading.RLock()  # the handler of a signal may need code while code is compiled
if hasattr(os, "register_at_fork"):  # no child has the lock of a thread that it does not have
    os.register_at_fork(
        before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release
    )


def code_of(text_of, step, W=1, for_each=False, align=0):
    """Return the address of the code of one of the texts; None where there can be none."""
    if config.DISABLE_JIT:
        return None
    key = text_of, step.indices.tobytes(), step.D, W, for_each, align
    with _lock:
        if key not in _codes:
            name = f"code_{next(_numbers)}"
            level = 2 if len(step.usual) < MANY else 0
            try:
                text = text_of(step, name, W, for_each, align)
                _codes[key] = _compile(text, name, level)
            except Exception as error:
                if None not in _codes.values():  # once a process
                    warnings.warn(
                        f"LLVM refuses the code of a field ({error}): NumPy takes steps of "
                        "thousands of trajectories, in 100 times the time, and of one, in 5000 "
                        "times; install a version of Numba that suslov_fast was tested with",
                        RuntimeWarning,
                        stacklevel=2,
                    )
                _codes[key] = None
        return _codes[key]


def _compile(text, name, level):
    """Return the address of a function in this text."""
    module = binding.parse_assembly(text)
    if level in _engines:
        _engines[level].add_module(module)
    else:
        _engines[level] = binding.create_mcjit_compiler(module, _machine(level))
    try:
        _engines[level].finalize_object()
        return _engines[level].get_function_address(name)
    finally:
        _engines[level].remove_module(module)


def _machine(level):
    """Return the processor as Numba sees it, with its settings."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    features = config.CPU_FEATURES
    if features is None:
        features = "" if config.CPU_NAME else binding.get_host_cpu_features().flatten()
    target = binding.Target.from_triple(binding.get_process_triple())
    cpu = config.CPU_NAME or binding.get_host_cpu_name()
    return target.create_target_machine(cpu=cpu, features=features, opt=level, jit=True)


# ------------------------------------------------------------------------------------------- calls
_CALL = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)


def call(address, job):
    """Call the code at an address with that of a job, an array; return its integer."""
    return _CALL(address)(job.ctypes.data)
