"""Error messages for functions that do not define a field.

A field needs f(x, **parameters) with x one tuple, and a polynomial of x as result. Functions
written for other packages, f(t, y), f(x, y, z) or f(u, p, t), and operations such as exp get a
message that ends in what to type, with the user's own names where they show what each argument is.
"""

import inspect
import re
import traceback
from collections.abc import Mapping, Sequence
from keyword import iskeyword
from typing import Any, NoReturn

from ...checks import page, short, wrong
from ...core.lists.records import FUNCTIONS, OTHER_NAMES
from .names import TIME, clash, free, labels
from .symbolic import HOW, Tracer, Untraceable

# Usual names of an array of parameters, of a state or a component, and of a state as a whole in
# functions for other packages. Parameters of fields rarely have these names.
_ARRAY = {"p", "par", "pars", "params", "parameters", "args", "theta"}
_STATE = re.compile(r"[xyzuvwqps]\d*|[XYZUVW]|state|states|vec")
_SURELY_STATE = re.compile(r"[xyzXYZ]\d*|state|states")
_VECTOR = {"X", "Y", "Z", "U", "V", "W", "state", "states", "vec"}
# Usual names of components that follow each other: x1, x2 or q1, p1; coordinates with momenta or
# velocities, such as x, y, px, py; and single letters, such as x, y, z.
_NUMBERED = re.compile(r"[A-Za-z]+_?\d+")
_WITH_RATES = re.compile(r"([pvd]_?)?[xyz](_?dot)?")
_RUNS = "xyzw", "xyzuvw", "xyuv", "xv", "uvw", "qp", "pq", "XYZW", "UVW"
GENERAL = "howto/motion"
_OURS = {"suslov_fast", "numpy", "numba"}  # packages whose errors are told otherwise
_LAMBDIFIED = "_lambdifygenerated"  # the name of functions of SymPy, which users do not see
# Functions of `math` with another name in NumPy.
_OF_MATH = {
    "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "asinh": "arcsinh",
    "acosh": "arccosh", "atanh": "arctanh", "pow": "power", "fabs": "abs", "ceil": "ceil",
}  # fmt: skip
# What errors of Python, NumPy and Numba say; a test raises each.
TEXTS = {
    "array of a number": "'(float|int)' object is not|non-iterable (float|int)|"
    "'(float|int)' has no len|for @: '(float|int)'|not have enough dimensions",
    "product of a number": "@|matmul",
    "linear algebra of symbols": "ufunc '(solve|inv|lstsq|det|qr|eig|svd)",
    "function of math": "must be real number, not",
    "function without symbols": "must be real number, not|not '(Expression|Polynomial|Symbol)'|"
    "object has no attribute",
    "time is None": "NoneType|fractions or floats, not None",
    "number of a symbol": "Polynomial|Expression|Symbol",
    "unpacking": "to unpack",
    "argument of Numba": "compute fingerprint",
}


def says(text: str, what: str) -> bool:
    """Return whether the text of an error is one of TEXTS."""
    return re.search(TEXTS[what], text) is not None


def is_state(name: str) -> bool:
    """Return whether the name of an argument suggests a state or a component of one."""
    return _STATE.fullmatch(name) is not None


def _is_run(names: Sequence[str]) -> bool:
    """Return whether the names of arguments suggest the components of a state, in order."""
    patterns = (_NUMBERED, _WITH_RATES)
    is_pattern = any(all(map(pattern.fullmatch, names)) for pattern in patterns)
    return is_pattern or any(run.startswith("".join(names)) for run in _RUNS)


def _arguments(f: Any) -> list[inspect.Parameter]:
    """Return the arguments of a function except *args and **kwargs; [] without a signature."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):
        return []
    stars = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return [a for a in arguments if a.kind not in stars]


def arguments_of(f: Any) -> list[str]:
    """Return the names of the required arguments of a function, and of a time argument."""
    return [a.name for a in _arguments(f) if a.default is a.empty or a.name in TIME]


def name_of(f: Any, argument: str) -> str:
    """Return the name of a function, or `argument` if it has none, as a lambda."""
    name = getattr(f, "__name__", "")
    is_name = name.isidentifier() and not iskeyword(name) and name != _LAMBDIFIED
    return name if is_name else argument


def check_callable(argument: str, f: Any) -> None:
    """Raise TypeError unless f is a function."""
    if callable(f):
        return
    example = "(x[0]**2 + x[1]**2) / 2" if argument == "H" else "(x[1], -x[0])"
    how = f": for example lambda x: {example}"
    if any(hasattr(each, "free_symbols") for each in (f if isinstance(f, (list, tuple)) else [f])):
        how = ": SymPy's lambdify makes one of expressions"
    expected = "a function of x, a tuple of the variables"
    raise wrong(argument, expected, f"{short(f)}{how}", TypeError)


def check_arguments(
    argument: str, f: Any, names: Sequence[str], given: Mapping[str, Any], maker: str = ""
) -> None:
    """Raise TypeError unless f takes the state alone, as one tuple, and the parameters `given`.

    `names` are those of the variables. Messages begin with `argument`, the name of the argument
    that holds f, and advise a call of `maker`, the public function that takes f.
    """
    arguments, f_name, D = arguments_of(f), name_of(f, argument), len(names)
    if taken := _signature(f):
        how = "write lambda x: ..." if taken == "()" else f"pass lambda x: {f_name}(*x)"
        raise TypeError(f"{argument} must take the state, as one tuple, not {f_name}{taken}: {how}")
    missing = [name for name in arguments[1:] if name not in given]
    is_timed = not TIME.isdisjoint(arguments)
    first = _first_scalar(arguments, names, given)
    parts = [name for name in arguments if name not in TIME]
    in_parts = first is None and 1 < len(parts) < D and D % len(parts) == 0 and _is_run(parts)
    if is_timed and first is None and not in_parts and maker.endswith("Field.from_function"):
        _check_time(argument, f, arguments, names, given)
    for_arrays = missing and ({*missing} <= _ARRAY or arguments[0] == f"d{missing[0]}")
    of_state = any(map(_SURELY_STATE.fullmatch, missing))
    if is_timed or (missing and (first is not None or in_parts or for_arrays or of_state)):
        if len(arguments) > 1 and arguments[0] == f"d{arguments[1]}":
            advice = f"return the {D} components, as a tuple"
        elif first is None and not (is_timed and parts) and not in_parts:
            advice = f"write a function of one tuple of {D}"
            if missing and {*missing} <= _ARRAY:
                advice = f"pass each parameter by its own name, as in {f_name}(x, sigma, rho)"
        else:
            states = (
                parts if in_parts else parts[:1] if first is None else arguments[first : first + D]
            )
            advice = _adapted(f_name, f, names, given, states, maker)
        if is_timed:
            advice += f"; for a forcing see {page(GENERAL)}"
        must = "must take the state alone, as one tuple, and parameters by name"
        received = f"{f_name}({', '.join(arguments)})"
        raise TypeError(f"{argument} {must}, not {received}: {advice}")
    unknown = _unknown(f, given)
    if missing:
        how = f"pass {missing[0]}=, a parameter, by name"
        if not _ARRAY.isdisjoint(unknown):
            how = "pass each parameter by its name, " + ", ".join(f"{name}=…" for name in missing)
        if is_state(missing[0]):
            how += f"; if {missing[0]} is a variable, count it among the {D + 1} of the dimension"
        if what := clash(missing[0], names, maker):
            other = free(missing[0], names, maker)
            how = f"this name is in use, for {what}: rename it, for example to {other}"
        others = f", not {', '.join(unknown)}" if unknown else ""
        raise TypeError(prefixed(argument, f"{f_name} needs {missing[0]}{others}: {how}"))
    if unknown:
        known = ", ".join(a.name for a in _arguments(f)[1:]) or "none"
        text = f"{f_name} has no parameter {', '.join(unknown)}; choose from: {known}"
        raise TypeError(prefixed(argument, text))


def _check_time(
    argument: str, f: Any, arguments: list[str], names: Sequence[str], given: Mapping[str, Any]
) -> None:
    """Say how to make time a variable, for a function f(t, y, ...) or f(y, t, ...) that uses t."""
    times = [name for name in arguments if name in TIME]
    state, *parameters = [name for name in arguments if name not in TIME] or [""]
    is_known = {*parameters} <= {*given} or _ARRAY.isdisjoint(parameters)
    if not state or len(times) > 1 or not is_known:
        return
    own = [name for name in names if name not in TIME]
    *components, time = Tracer([*own, *times], ()).state
    values = {name: given.get(name, 1.0) for name in parameters}
    try:
        f(**values, **{state: (*components,), times[0]: None})
    except Exception:  # f may raise anything for a time that is None
        try:
            f(**values, **{state: (*components,), times[0]: time})
        except Exception as error:  # nor does it take a variable
            if not says(str(error), "function of math"):
                return
    else:
        return
    f_name = name_of(f, argument)
    s = next(each for each in ("s", "x", "state") if each not in {*parameters, f_name})
    texts = {state: f"{s}[:-1]", times[0]: f"{s}[-1]"}
    passed = [texts.get(name, name) for name in arguments]
    if [each.name for each in _arguments(f)][: len(arguments)] != arguments:
        passed = [f"{name}={text}" for name, text in zip(arguments, passed, strict=True)]
    function = f"lambda {', '.join([s, *parameters])}: (*{f_name}({', '.join(passed)}), 1)"
    numbers = "".join(f", {name}={_value(name, given, '…')}" for name in parameters)
    call = f'Field.from_function({function}, "{" ".join([*own, *times])}"{numbers})'
    received = f"{f_name}({', '.join(arguments)})"
    raise TypeError(
        f"{argument} must take the state alone, as one tuple, not {received}: "
        f"make time a variable with the derivative 1, {call}"
    )


def _signature(f: Any) -> str:
    """Return the signature of a function that takes no state as a whole, such as "(*args)"."""
    try:
        signature = inspect.signature(f)
    except (TypeError, ValueError):
        return ""
    kinds = [each.kind for each in signature.parameters.values()]
    return str(signature) if kinds[:1] in ([], [inspect.Parameter.VAR_POSITIONAL]) else ""


def prefixed(argument: str, text: str) -> str:
    """Return a message that begins with the name of an argument, unless the text does."""
    return text if text.startswith(f"{argument} ") else f"{argument}: {text}"


def _unknown(f: Any, given: Mapping[str, Any]) -> list[str]:
    """Return the names of the given parameters that a function does not accept."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):
        return []
    if any(a.kind == a.VAR_KEYWORD for a in arguments):
        return []
    accepted = {a.name for a in arguments}
    return [name for name in given if name not in accepted]


def _first_scalar(arguments: list[str], names: Sequence[str], given: Any) -> int | None:
    """Return the index of the first of D arguments that are the components of a state, or None."""
    D, first = len(names), int(bool(arguments) and arguments[0] in TIME)
    components = arguments[first : first + D]
    if len(components) != D or D == 1 or not {*components}.isdisjoint([*TIME, *given]):
        return None
    if components == [*names]:
        return first
    if not _ARRAY.isdisjoint(components[1:]) and components[0] != "q":  # f(u, p, t)
        return None
    after = arguments[first + D :]
    if components[0] in _VECTOR and not is_state(components[1]):  # f(X, a, b, t)
        return None
    if _is_run(components) or (not first and after and after[0] in TIME):
        return first  # f(x, y, z, a), or f(a, b, c, t)
    # f(t, a, b, c), or as many arguments as variables.
    return first if (first or not after) and not is_state(components[0]) else None


def _adapted(
    f_name: str, f: Any, names: Sequence[str], given: Any, states: Sequence[str], maker: str
) -> str:
    """Return a call of `maker` with a lambda that passes one tuple of variables to f as f takes it.

    `states` are those arguments of f that hold the state: one for all of it, one for each of the D
    components, or one for each of several parts of equal length.
    """
    D, m = len(names), len(names) // len(states)
    state = next(each for each in ("x", "u", "state") if each not in {*given, f_name})
    texts = {each: f"{state}[{m * k}:{m * (k + 1)}]" for k, each in enumerate(states)}
    if len(states) == 1:
        texts = {states[0]: state}
    elif [*states] == ["p", "q"] and maker.endswith("from_hamiltonian"):  # q is first
        at = (f"{m}:{2 * m}", f":{m}") if m > 1 else (1, 0)
        texts = {"p": f"{state}[{at[0]}]", "q": f"{state}[{at[1]}]"}
    elif m == 1:
        texts = {states[0]: f"*{state}", **dict.fromkeys(states[1:], "")}
    texts |= dict.fromkeys(TIME, "None")
    passed, parameters, is_by_name = [], {}, False
    for each in _arguments(f):
        name = each.name
        text = texts.get(name)
        if text is None:
            if each.default is not each.empty and name not in given:
                is_by_name = True  # for all arguments after it
                continue
            text = name
            if name in given or len(states) > 1 or name not in _ARRAY:
                text = parameters[name] = free(name, [*names, f_name, state], maker)
        is_by_name = is_by_name or each.kind == each.KEYWORD_ONLY
        if text:
            passed.append(f"{name}={text}" if is_by_name else text)
    function = f"lambda {', '.join([state, *parameters.values()])}: {f_name}({', '.join(passed)})"
    size = D if tuple(names) == labels(D) else repr(" ".join(names))
    values = (f", {new}={name if name in given else '…'}" for name, new in parameters.items())
    whole = f"{maker}({function}, {size}{''.join(values)})" if maker else function
    return f"pass {whole}" if parameters else f"pass {function}, as in {whole}"


def _value(name: str, given: Mapping[str, Any], missing: str = "") -> Any:
    """Return what to pass for a parameter: its number, else a variable of its name."""
    if name not in given:
        return missing
    value = given[name]
    return value if isinstance(value, (int, float)) else name


def field_call(f: Any, argument: str, names: Sequence[str], parameters: Mapping[str, Any]) -> str:
    """Return the call that makes a `Field` of a function f, or of a Hamiltonian."""
    maker = "from_hamiltonian" if argument == "H" else "from_function"
    size = len(names) if tuple(names) == labels(len(names)) else repr(" ".join(names))
    values = (f", {name}={_value(name, parameters)}" for name in parameters)
    return f"Field.{maker}({name_of(f, argument)}, {size}{''.join(values)})"


def explained(error: Exception, f_name: str, names: Sequence[str], is_family: bool) -> str:
    """Return the cause, in words, of an error that f raised when it was called with polynomials."""
    text = " ".join(str(error).split())
    if hasattr(error, "in_words"):  # NoPolynomial or NoPower
        return f"{f_name} {error.in_words(names)}"
    if isinstance(error, Untraceable):
        return text
    if how := _of_package(error) or _of_math(error):
        return how
    if package := _other_package(error):
        how = "write formulas of + - * / ** and functions of NumPy"
        return f"{f_name} calls {package}, which takes no symbols ({text}): {how}"
    if _is_of_numba(error):
        how = "call its Python function, g.py_func(*x) in place of g(*x)"
        return f"{f_name} calls a function compiled by Numba, which takes no symbols: {how}"
    if says(text, "time is None"):
        how = f"make time a variable, whose derivative is 1, see {page(GENERAL)}"
        return f"{text}: if you pass None for t, the right-hand side depends on t: {how}"
    if is_family and says(text, "array of a number"):
        how = "pass each number by its own name, such as sigma=10, rho=28"
        if says(text, "product of a number"):
            how = "define a constant matrix inside f, not as a parameter"
        return f"{text}: an array is a family, and f receives one number at a time: {how}"
    if says(text, "linear algebra of symbols"):
        constant = "multiply by the inverse of a constant matrix, as in Inverse @ np.array(x)"
        how = f"{constant}; if the matrix depends on x, write its inverse as formulas"
        return f"numpy.linalg cannot compute with symbols ({text}): {how}"
    if says(text, "number of a symbol"):
        if isinstance(error, AttributeError):
            return f"{text}: x holds symbols, for + - * / and ** alone; see {page(GENERAL)}"
        why = "x holds symbols, so f cannot use if or float of them, or store them in an array"
        how = "return a tuple of expressions, or fill np.zeros(n, dtype=object)"
        return f"{text}: {why} of floats: {how}; see {page(GENERAL)}"
    if len(names) == 1 and len(names[0]) > 1 and re.search("to unpack|but the dimension", text):
        return f"{text}: {names[0]!r} is one name, write {' '.join(names[0])!r} for {len(names[0])}"
    if says(text, "unpacking"):
        wanted = re.search(r"expected (\d+)", text)
        how = f": if {f_name} unpacks x, there are {len(names)} variables to unpack"
        if wanted and int(wanted[1]) != len(names):
            given = f"{len(names)} variables were given, {', '.join(names)}"
            how = f": {given}, and {wanted[1]} are unpacked"
        return f"{text}{how}"
    return text


def _of_package(error: Exception) -> str:
    """Return what to write in place of a function of NumPy or of a package."""
    text = str(error)
    function = of_numpy(error)
    if found := re.search(r"ufunc '(\w+)' not supported", text):
        function = found[1]
        if function in FUNCTIONS:  # which has no loop for objects
            how = f"x is an array, write {function}(x) in place of {function}(np.array(x))"
            return f"{function} of an array made by np.array takes no symbols: {how}"
    if not function:
        return ""
    how = f"write {HOW[function]}" if function in HOW else "write formulas of the entries"
    return f"calls {function} of NumPy, which takes no symbols: {how}"


def _of_math(error: Exception) -> str:
    """Return what to write where a number was wanted, and a symbol came; "" for other errors."""
    text = str(error)
    wants_integer = "cannot be interpreted as an integer" in text or "list indices" in text
    if wants_integer and "Symbol" in text:
        how = "fix it in f, as in lambda x, a: f(x, a, n=3)"
        return f"a parameter or a component counts or is an index, and has no value yet: {how}"
    if "must be real number, not" not in text and "() argument must be" not in text:
        return ""
    frames = traceback.extract_tb(error.__traceback__)
    last = frames[-1]
    if "site-packages" in last.filename or last.filename.endswith(".pyx"):
        how = "write formulas of NumPy, and np.interp(x, knots, values) for a table or a spline"
        return f"a function of a package takes no symbols: {how}"
    segment = _segment(last)
    line = (segment or last.line or "").strip()
    if re.fullmatch(r"\w+\[.*\]", segment):  # the target of an assignment
        how = "return a tuple, or fill np.zeros(n, dtype=object) or np.zeros_like(x)"
        return f"{line}: an array of floats takes no symbols: {how}"
    found = re.search(r"\bmath\.(\w+)\(", segment or line) or re.search(r"\b(\w+)\(", segment)
    if found is None or found[1] in ("float", "int", "array", "asarray", "complex"):
        how = "leave the conversion out; np.floor in place of int, np.array(x, object) for arrays"
        return f"{line}: a symbol has no value yet, so it is not converted to a number: {how}"
    name = _OF_MATH.get(found[1], found[1])
    if name not in FUNCTIONS and name not in OTHER_NAMES:
        how = f"write {HOW[name]}" if name in HOW else "write a formula of NumPy's functions"
        return f"{line}: {found[1]} takes no symbols: {how}"
    call = re.sub(rf"(math\.)?\b{found[1]}\(", f"np.{name}(", segment or found[0])
    return f"{found[0]}…) of math takes no symbols: write np.{name}, as in {call}"


def _segment(frame: Any) -> str:
    """Return the part of the line of a frame that raised."""
    line, begin, end = frame.line or "", getattr(frame, "colno", None), frame.end_colno
    if begin is None or end is None or frame.lineno != frame.end_lineno:
        return line
    original = frame._original_line if hasattr(frame, "_original_line") else line
    return str(original)[begin:end]


def raise_explained(argument: str, error: Exception, cause: str) -> NoReturn:
    """Raise a TypeError or a ValueError with the cause of an error that f raised.

    An error of another class, of which nothing more is known, is raised as it is.
    """
    is_value = isinstance(error, (ValueError, IndexError, ArithmeticError))
    is_usual = is_value or isinstance(error, (TypeError, AttributeError))
    if not is_usual and cause == " ".join(str(error).split()):
        raise error
    kind = ValueError if is_value else TypeError
    raise kind(prefixed(argument, cause)) from (error if is_usual else None)


def of_numpy(error: Exception) -> str:
    """Return the function of NumPy, written in Python, that failed because it takes no symbols."""
    if not says(str(error), "function without symbols"):
        return ""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__", "").partition(".")[0] == "numpy":
            return frame.f_code.co_name
    return ""


def _other_package(error: Exception) -> str:
    """Return the installed package in whose Python code an error was raised, as "scipy"."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    package: str = frame.f_globals.get("__name__", "").partition(".")[0]
    is_installed = re.search(r"(site|dist)-packages", frame.f_code.co_filename)
    return package if is_installed and package not in _OURS else ""


def _is_of_numba(error: Exception) -> bool:
    return type(error).__module__.startswith("numba") or says(str(error), "argument of Numba")
