"""LLVM's intermediate representation as text, and the machine code that LLVM makes of it.

LLVM forms no FMA and keeps the order of operations. Compiling takes 0.3 to 0.5 ms an operation.
Machine code stays as long as its `Address`. Addresses in the text are integers, because versions of
LLVM write the types of pointers differently.
"""

import ctypes
import itertools
import threading
from contextlib import contextmanager

import numpy as np
from llvmlite import binding
from numba import config

from ..compiling.numba import advice_on_numba
from ..lists.far import LIMIT, PARTS, text_of_far
from ..lists.step import OF_BITS, OF_LIBRARY, OF_LISTS, OF_TRUTH_VALUES, list_of
from ..lists.tables import is_table

# Codes that are kept, beside those that last. Each takes two memory mappings; Linux grants 65,530
# to a process, and LLVM ends the process where it gets none.
MOST_CODES = 4096


def pointer(kind):
    """Return the type of an address of this type, as this version of LLVM writes it."""
    return "ptr" if binding.llvm_version_info[0] > 16 else f"{kind}*"


class Text:
    """The text of a function for lines of W lanes; instructions go to `target`, if there is one.

    V, M and I are the types of W numbers, of W truth values and of the bits of W numbers.
    """

    def __init__(self, W, target=None):
        self.W, self.target = W, target or self
        self.lines, self.count, self.declared, self.functions = [], 0, set(), {}
        self._usual = {}  # whether no lane is far, by operand
        self.V = f"<{W} x double>" if W > 1 else "double"
        self.M = f"<{W} x i1>" if W > 1 else "i1"
        self.I = f"<{W} x i64>" if W > 1 else "i64"
        self.suffix = f"v{W}f64" if W > 1 else "f64"

    def add(self, line):
        self.target.lines.append(line)

    def new(self, instruction):
        """Add an instruction; return the name of its value."""
        self.target.count += 1
        self.target.lines.append(f"  %v{self.target.count} = {instruction}")
        return f"%v{self.target.count}"

    def label(self, name):
        self.lines.append(f"{name}:")
        self.block = name

    def jump(self, label):
        self.add(f"  br label %{label}")

    def branch(self, truth, label, other, likely=None):
        """Go to `label` if a truth value is true, else to `other`; `likely` is a hint for LLVM."""
        weights = {None: "", True: ", !prof !0", False: ", !prof !2"}[likely]
        self.add(f"  br i1 {truth}, label %{label}, label %{other}{weights}")

    def load(self, kind, address, align=8):
        pointed = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        return self.new(f"load {kind}, {pointer(kind)} {pointed}, align {align}")

    def store(self, kind, value, address, align=8, mark="", how=""):
        pointed = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        self.add(f"  store {how}{kind} {value}, {pointer(kind)} {pointed}, align {align}{mark}")

    def store_chosen(self, value, address):
        """Store W numbers that are a choice between those at the address and others.

        LLVM would make a masked store of it, which takes up to 40 cycles on processors of AMD.
        """
        self.store(self.V, value, address, how="volatile ")

    @contextmanager
    def loop(self, name, count):
        """Add a loop over 1 or more indices, whose body is the block of `with`."""
        before, index = self.block, f"%{name}_index"
        self.jump(name)
        self.label(name)
        self.add(f"  {index} = phi i64 [ 0, %{before} ], [ {index}1, %{name}_end ]")
        yield index
        self.jump(f"{name}_end")
        self.label(f"{name}_end")
        self.add(f"  {index}1 = add i64 {index}, 1")
        self.branch(self.compare_integers("ult", f"{index}1", count), name, f"{name}_after")
        self.label(f"{name}_after")

    # ------------------------------------------------------------------------------------ integers
    def integer(self, instruction, a, b):
        return self.new(f"{instruction} i64 {a}, {b}")

    def plus(self, address, offset):
        return self.integer("add", address, offset) if offset else address

    def compare_integers(self, how, a, b):
        return self.new(f"icmp {how} i64 {a}, {b}")

    # --------------------------------------------------------------------------------------- lines
    def constant(self, number):
        """Return W equal constants, without the type V."""
        bits = f"0x{np.float64(number).view(np.uint64):016X}"
        return bits if self.W == 1 else f"<{', '.join([f'double {bits}'] * self.W)}>"

    def splat(self, number, W):
        """Return a vector of W numbers that are equal to a number."""
        kind = f"<{W} x double>"
        first = self.new(f"insertelement {kind} undef, double {number}, i32 0")
        return self.new(f"shufflevector {kind} {first}, {kind} undef, <{W} x i32> zeroinitializer")

    def operate(self, instruction, a, b):
        return self.new(f"{instruction} {self.V} {a}, {b}")

    def absolute(self, a):
        return self._call("fabs", a)

    def root(self, a):
        return self._call("sqrt", a)

    def floor(self, a):
        return self._call("floor", a)

    def _call(self, name, *operands):
        function = f"{self.V} @llvm.{name}.{self.suffix}"
        kinds = ", ".join([self.V] * len(operands))
        self.target.declared.add(f"declare {function}({kinds})")
        return self.new(f"call {function}({self._typed(operands)})")

    def _typed(self, operands):
        return ", ".join(f"{self.V} {operand}" for operand in operands)

    def operate_on_bits(self, instruction, *operands):
        a, b = (self.new(f"bitcast {self.V} {operand} to {self.I}") for operand in operands)
        bits = self.new(f"{instruction} {self.I} {a}, {b}")
        return self.new(f"bitcast {self.I} {bits} to {self.V}")

    def compare(self, how, a, b):
        return self.new(f"fcmp {how} {self.V} {a}, {b}")

    def select(self, truth, a, b):
        return self.new(f"select {self.M} {truth}, {self.V} {a}, {self.V} {b}")

    def joined(self, instruction, truths):
        """Return all truth values joined by an instruction, from left to right."""
        result, *others = truths
        for truth in others:
            result = self.new(f"{instruction} {self.M} {result}, {truth}")
        return result

    def all_true(self, truth):
        """Return whether the truth values of all lanes are true."""
        if self.W == 1:
            return truth
        truth = self.new(f"bitcast {self.M} {truth} to i{self.W}")
        return self.new(f"icmp eq i{self.W} {truth}, -1")

    def bits(self, truth):
        """Return the truth values of all lanes as the bits of an integer."""
        if self.W > 1:
            truth = self.new(f"bitcast {self.M} {truth} to i{self.W}")
        return self.new(f"zext i{self.W} {truth} to i64")

    def carry_out(self, operations, values, load):
        """Add operations; `load` returns the name of a value that is not in the dict `values`."""
        M = self.M
        for instruction, number, operands in operations:
            names = []
            for operand in operands:
                if isinstance(operand, float):
                    names.append(self.constant(operand))
                    continue
                if operand not in values:
                    values[operand] = load(operand)
                names.append(values[operand])
            if instruction in ("fabs", "sqrt", "floor", "copysign"):
                name = self._call(instruction, *names)
            elif instruction == "sum":
                name = names.pop(0) if len(names) % 2 else None
                for a, b in zip(names[::2], names[1::2], strict=True):
                    product = self.operate("fmul", a, b)
                    name = product if name is None else self.operate("fadd", name, product)
            elif instruction in ("max", "min"):
                is_first = self.compare("ogt" if instruction == "max" else "olt", *names)
                name = self.select(is_first, *names)
            elif instruction == "select":
                name = self.select(*names)
            elif instruction in ("and", "or", "xor"):
                name = self.new(f"{instruction} {M} {names[0]}, {names[1]}")
            elif instruction in OF_TRUTH_VALUES:
                name = self.compare(instruction, *names)
            elif instruction in OF_BITS:
                name = self.operate_on_bits(instruction.removeprefix("bits_"), *names)
            elif instruction in PARTS:
                name = self._far_part(instruction, *names)
            elif instruction in OF_LISTS:
                name = self._call_list(instruction, names)
            elif instruction in OF_LIBRARY:
                kinds = ", ".join(["double"] * len(names))
                self.target.declared.add(f"declare double @{instruction}({kinds})")
                name = self._by_lane(f"double @{instruction}", names)
            elif is_table(instruction):
                name = self._by_lane(f"double @{self.table(instruction)}", names)
            else:
                name = self.operate(instruction, *names)
            values[number] = name

    def _by_lane(self, function, operands):
        """Call a function of numbers for each lane; return the results."""
        if self.W == 1:
            return self.new(f"call {function}({self._typed(operands)})")
        result = "undef"
        for l in range(self.W):
            of_lane = [self.new(f"extractelement {self.V} {a}, i32 {l}") for a in operands]
            numbers = ", ".join(f"double {number}" for number in of_lane)
            number = self.new(f"call {function}({numbers})")
            result = self.new(f"insertelement {self.V} {result}, double {number}, i32 {l}")
        return result

    def _call_list(self, name, operands):
        """Call the function of W lanes that carries out the list of an elementary function.

        The text defines it once.
        """
        function = f"lanes_{name}_{self.W}"
        if function not in self.target.functions:
            operations, result = list_of(name)
            text, values = Text(self.W), {k: f"%x{k}" for k in range(len(operands))}
            given = text._typed(values.values())
            text.add(f"define internal {self.V} @{function}({given}) #0 {{")
            text.label("entry")
            text.carry_out(operations, values, None)
            text.add(f"  ret {self.V} {values[result]}")
            self.target.functions |= text.functions | {function: [*text.lines, "}"]}
            self.target.declared |= text.declared
        return self.new(f"call {self.V} @{function}({self._typed(operands)})")

    def _far_part(self, instruction, x, usual):
        """Return a value of `far.remainder` for lanes from LIMIT on, else `usual`."""
        target, label = self.target, f"{instruction}_{self.target.count}"
        before = target.block
        if x not in self._usual:  # once for all values of x
            self._usual[x] = self.compare_integers("eq", self.bits(self._is_far(x)), 0)
        is_usual = self._usual[x]
        target.branch(is_usual, f"{label}_end", label, likely=True)
        target.label(label)
        operands = f"{self._typed([x, usual])}, i64 {[*PARTS].index(instruction)}"
        far = self.new(f"call {self.V} @far_{self.W}({operands})")
        target.jump(f"{label}_end")
        target.label(f"{label}_end")
        if f"far_{self.W}" not in target.functions:
            target.functions |= {"far": [text_of_far(pointer)], f"far_{self.W}": self._far_lanes()}
            target.declared.add("declare i192 @llvm.ctlz.i192(i192, i1)")
        return self.new(f"phi {self.V} [ {usual}, %{before} ], [ {far}, %{label} ]")

    def _is_far(self, x):
        from_limit = self.compare("oge", x, self.constant(LIMIT))
        return self.joined("and", [from_limit, self.compare("olt", x, self.constant(np.inf))])

    def _far_lanes(self):
        """Return the lines of the function for `_far_part`, which loops over lanes."""
        text, lane = Text(self.W), Text(1)
        lane.target = text
        operands = f"{self.V} %x, {self.V} %usual, i64 %number"
        text.add(f"define internal {self.V} @far_{self.W}({operands}) #0 {{")
        text.label("entry")
        memory = text.new(f"alloca {self.V}, i64 2, align 64")
        memory = text.new(f"ptrtoint {pointer(self.V)} {memory} to i64")
        result = text.plus(memory, 8 * self.W)
        text.store(self.V, "%x", memory)
        text.store(self.V, "%usual", result)
        with text.loop("lane", self.W) as l:
            offset = text.integer("mul", l, 8)
            x = text.load("double", text.integer("add", memory, offset))
            text.branch(lane._is_far(x), "far", "next")
            text.label("far")
            far = text.new(f"call double @far(double {x}, i64 %number)")
            text.store("double", far, text.integer("add", result, offset))
            text.jump("next")
            text.label("next")
        text.add(f"  ret {self.V} {text.load(self.V, result)}")
        return [*text.lines, "}"]

    def finished(self):
        """Return the text with the end of the function and all that it refers to."""
        return "\n".join([
            *self.lines, "}", *sorted(self.declared), *itertools.chain(*self.functions.values()),
            # Lines are whole registers also where LLVM prefers narrower ones. Without an aligned
            # stack, registers saved there may lie across cache lines, in one process or another.
            'attributes #0 = { nounwind "stackrealign" "min-legal-vector-width"="512" }',
            '!0 = !{!"branch_weights", i32 1000000, i32 1}', "!1 = !{i32 1}",
            '!2 = !{!"branch_weights", i32 1, i32 1000000}', "",
        ])  # fmt: skip


# ------------------------------------------------------------------------------------------ compile
class Address(int):
    """The address of machine code, which stays as long as this object: that keeps its engine."""


known_codes = {}  # addresses, by the arguments of `code_of`
_engines = {}  # by level of optimisation, and whether their code lasts
_numbers = itertools.count()  # which make names unique, also after Ctrl-C
_lock = threading.RLock()  # reentrant, because a signal may arrive while code is compiled


def code_of(text_of, step, W=1, *options, lasts=False):
    """Return the `Address` of the machine code of `text_of(step, name, W, *options)`.

    Code that `lasts` stays until the process ends.
    """
    kind = type(step), getattr(step, "keeps_signs", None)
    key = text_of, step.indices.tobytes(), step.D, kind, W, *options
    level = 0 if step.is_long else 2
    return compiled(key, lambda name: text_of(step, name, W, *options), level, lasts)


def compiled(key, text_of, level=2, lasts=False, passes=False):
    """Return the `Address` of the machine code of the text `text_of(name)`, see `code_of`.

    `key` tells the text from others; `level` is that of LLVM's optimisation, which takes three
    times as long with `passes` over its text.
    """
    key = key, level, passes, lasts
    with _lock:
        if key not in known_codes:
            _free_old()
            name = f"code_{next(_numbers)}"
            text = text_of(name)  # an error here is the package's own
            try:
                known_codes[key] = _compile(text, name, level, lasts, passes)
            # LLVM cannot read the text, or llvmlite has a function no more, or in another form.
            except (RuntimeError, AttributeError, TypeError) as error:
                text = f"LLVM refuses the code of a field ({error})"
                raise RuntimeError(
                    f"{text}; {advice_on_numba() or 'please report this'}"
                ) from error
        return known_codes[key]


def _free_old():
    """Forget the codes that do not last, if there are MOST_CODES of them, and their engines."""
    # A signal handler may compile or free codes between any two lines, so the loops need copies.
    old = [key for key in known_codes.copy() if not key[-1]]
    if len(old) >= MOST_CODES:
        for key in old:
            known_codes.pop(key, None)
        for key in _engines.copy():
            if not key[-1]:
                _engines.pop(key, None)


def _compile(text, name, level, lasts, passes):
    """Return the address of the function with this name in a text."""
    module, kind = binding.parse_assembly(text), (level, lasts)
    if passes:
        options = binding.create_pipeline_tuning_options(speed_level=1)
        builder = binding.create_pass_builder(_machine(level), options)
        builder.getModulePassManager().run(module, builder)
    if kind in _engines:
        _engines[kind].add_module(module)
    else:
        _engines[kind] = binding.create_mcjit_compiler(module, _machine(level))
    engine = _engines[kind]
    try:
        engine.finalize_object()
        address = Address(engine.get_function_address(name))
    finally:
        engine.remove_module(module)
    address.engine = engine
    address.call = _CALL(address)  # takes the address of an array; made once, for small calls
    return address


def _machine(level):
    """Return the target machine for the processor and the features that Numba compiles for."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_triple(binding.get_process_triple())
    cpu = config.CPU_NAME or binding.get_host_cpu_name()
    return target.create_target_machine(cpu=cpu, features=_features(), opt=level, jit=True)


def _features():
    """Return the features of the processor that code is made for, as LLVM spells them."""
    if config.CPU_FEATURES is not None:
        return config.CPU_FEATURES
    return "" if config.CPU_NAME else binding.get_host_cpu_features().flatten()


def numbers_in_register():
    """Return how many numbers a register of the processor holds, at least."""
    features = _features().split(",")
    return 8 if "+avx512f" in features else 4 if "+avx2" in features else 2


# ------------------------------------------------------------------------------------------- calls
_CALL = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)


def address_of(array):
    """Return the address of a writeable array without gaps, in a third of the time of NumPy."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array)) if array.size else 0


def call(address, array):
    """Call the code at an address with the address of an array; return its integer."""
    return address.call(array.ctypes.data)
