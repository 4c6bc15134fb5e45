"""Files of strangers: each is answered at once by an error, and no code in it runs."""

import io
import json
import re
import zipfile

import numpy as np
import pytest

import suslov_fast as sf

FIELD = {"body": "Field", "names": ["x", "y"], "indices": [[0, 1], [1, 0], [2, 2]]}
FIELD |= {"values": [1, -1]}
K = {"indices": [[0, 1], [1, 0]], "values": [1, -1]}
OF_H = {"body": "Field", "names": ["q", "p"], "H": "q", "K": K}
OF_X = {"body": "Field", "names": ["x"], "equations": ["x"]}
BODY = {"body": "Suslov3D", "I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3}
PRIMES = [p for p in range(3, 3000) if all(p % q for q in range(2, int(p**0.5) + 1))]


def nested(depth):
    value = 1.0
    for _ in range(depth):
        value = [value]
    return value


# Dictionaries that a small file can hold, each with the name that the error has.
DICTIONARIES = {
    "dimension": (FIELD | {"dimension": 10**12}, "dimension"),
    "names as digits": (FIELD | {"names": "9" * 100_000}, "names"),
    "number of names": (FIELD | {"names": 10**12}, "names"),
    "long name": (FIELD | {"names": ["a" * 10**6, "b"]}, "names"),
    "equal names": (FIELD | {"names": ["a"] * 100_000}, "names"),
    "names of other letters": (FIELD | {"names": "ϕ p"}, "names"),
    "long parameter": (OF_H | {"parameters": {"a" * 10**6: 1.0}}, "parameters"),
    "long number": (FIELD | {"values": ["9" * 10**6, 1]}, "values"),
    "long denominator": (FIELD | {"values": ["1/" + "9" * 9_000, 1]}, "values"),
    "large exponent": (FIELD | {"values": ["1e999999999", 1]}, "values"),
    "not a number": (FIELD | {"values": ["nan", 1]}, "values"),
    "infinite": (FIELD | {"values": [float("inf"), 1]}, "values"),
    "deep matrix": (OF_H | {"K": nested(400)}, "K"),
    # Python 3.11 cannot write it into the error of the one parameter.
    "deep mapping": (BODY | {"I1": {"a": {"a": nested(900)}}}, "I1|parameters"),
    "repeated terms": (
        FIELD
        | {
            "indices": [[0] * 400, [1] * 400, [0] * 400],
            "values": [f"{p**60}/{p**60 + 1}" for p in PRIMES[:400]],
        },
        "indices",
    ),
    "indices beyond": (FIELD | {"indices": [[0, 1], [1, 0], [2, 10**18]]}, "indices"),
    "too many equations": ({"body": "Field", "names": ["x"], "equations": ["x", "x"]}, "equations"),
    "another variable": ({"body": "Field", "names": ["x"], "equations": ["z"]}, "'z'"),
    "equations beside H": (OF_X | {"H": "x"}, "H|equations"),
    "class of Python": ({"body": "object"}, "body"),
}
# Texts of equations.
LONG = {
    "powers": "((((9**400)**400)**400)**400)*x",
    "quotient of powers": "((1/9)**-400)**400",
    "computed exponent": "(9**400)**(200 + 200)",
    "product of powers": "*".join(["9**400"] * 2_000),
    "brackets": "(" * 10_000 + "x" + ")" * 10_000,
    "functions": "exp(" * 150 + "x" + ")" * 150,
    "signs": "-" * 50_000 + "x",
    "long": "x + " * 300_000 + "x",
    "hexadecimal": "0x" + "f" * 500_000,
    "digits": "9" * 500_000,
}
SHORT = [
    "__import__('os').system('exit')", "exit()", "(lambda: 1)()", "lambda: x", "(y:=1)",
    "[x for x in y]", "x.real", "x[0]", "y", "'a'", "f'{x}'", "1j*x", "x if x > 0 else 1",
    "x and x", "0 < x < 1", "x & 1", "1<<10**10", "x@y", "1/0*x", "sin(x, x)", "sin(x=x)",
    "sin((1, 2))", "where(x > 0, 1)", "interp(x, x, x)", "interp(x, (0, 1), (1, 2, 3), 1, 2)",
    "(x, x)", "x = 1", "x\n+y", "x\x00", "", None, ["x"], "1e999", "nan", "inf*x", "x**inf",
    "x // nan", "inf/x", "exp(1e308*10*x)", "where(x > 0, nan*x, 1)",
]  # fmt: skip


def refused(function, *arguments):
    """Return the error of a call, of few words."""
    with pytest.raises((ValueError, TypeError)) as told:
        function(*arguments)
    assert len(str(told.value)) < 500
    return told.value


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Return the entries of the file of a run."""
    path = tmp_path_factory.mktemp("strangers") / "run.npz"
    sf.iterate(sf.Field.from_dict(FIELD), [0.1, 0.2], 0.1, 3).save(path)
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def write(path, entries, **others):
    """Write the entries of a run with others in place of some."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in (entries | others).items():
            file.writestr(name, data)


@pytest.mark.parametrize("name", DICTIONARIES)
def test_dictionaries_and_files_are_refused(name, saved, tmp_path):
    given, words = DICTIONARIES[name]
    kind = sf.Suslov3D if given.get("body") == "Suslov3D" else sf.Field
    assert re.search(words, str(refused(kind.from_dict, given)))
    text = json.dumps(given)
    body = io.BytesIO()
    np.save(body, text)
    write(tmp_path / "run.npz", saved, **{"body.npy": body.getvalue()})
    assert "run.npz" in str(refused(sf.load, tmp_path / "run.npz"))


@pytest.mark.parametrize("text", [*LONG.values(), *SHORT], ids=[*LONG, *map(repr, SHORT)])
def test_equations_are_refused(text):
    given = {"body": "Field", "names": ["x"], "equations": [text]}
    assert "equations" in str(refused(sf.Field.from_dict, given))


def test_objects_in_files_of_runs_are_not_read(saved, tmp_path):
    path, objects = tmp_path / "run.npz", io.BytesIO()
    np.save(objects, np.array([print], object), allow_pickle=True)
    for name in ("states", "about", "body"):
        write(path, saved, **{f"{name}.npy": objects.getvalue()})
        assert "run.npz" in str(refused(sf.load, path))


def test_names_that_python_would_read_as_others():
    """A name keeps its letters in a file, and Python's source text normalizes them."""
    for text in ("ϕ", "ﬁ", "x²", "ª", "µ"):
        for make in (
            lambda name: sf.Field(lambda x: (x[0], x[1]), [name, "y"]),
            lambda name: sf.Field.from_terms(np.zeros((2, 2, 2)), names=[name, "y"]),
            lambda name: sf.Field(lambda x, **_: (x[0], x[1]), 2, **{name: 1.0}),
        ):
            with pytest.raises(ValueError, match=r"dimension|names|parameters"):
                make(text)
    plain = sf.Field(lambda x, μ: (x[1], -μ * x[0]), "φ p", μ=2.0)
    assert sf.Field.from_dict(plain.to_dict()) == plain
    assert sf.Field(lambda x: (x[0],), ["é"]).names == ("é",)
