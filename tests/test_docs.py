"""Every page of the documentation runs, and prints what its comments say."""

import contextlib
import io
import re
from pathlib import Path

import pytest

import suslov_fast

DOCS = Path(__file__).parent.parent / "docs"
PAGES = [
    path
    for path in sorted(DOCS.rglob("*.md"))
    if not {"_build", "gallery", "reference"} & set(path.relative_to(DOCS).parts)
]
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))
BLOCK = re.compile(r"^```(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What a page says that it prints: after the call, or on lines of their own that follow it.
PRINTED = re.compile(r"^\s*print\(.*\)  # (.*)$|^# (.*)$", re.MULTILINE)
DIRECTIVES = {"{toctree}", "{include}", "{eval-rst}"}


def name(path):
    return path.relative_to(DOCS).as_posix()


def blocks(path, language):
    text = path.read_text(encoding="utf-8")
    return [code for found, code in BLOCK.findall(text) if found == language]


@pytest.mark.parametrize("path", PAGES, ids=name)
def test_every_block_is_of_a_known_kind(path):
    kinds = {kind for kind, _ in BLOCK.findall(path.read_text(encoding="utf-8"))}
    assert kinds <= {"python", "sh", "text", "bibtex", "yaml"} | DIRECTIVES


@pytest.mark.compiled
@pytest.mark.parametrize("path", [path for path in PAGES if blocks(path, "python")], ids=name)
def test_page(path, tmp_path, monkeypatch):
    """Its blocks of Python, one after the other, as a reader would."""
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for code in blocks(path, "python"):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, path.name, "exec"), names)
        expected = [after or below for after, below in PRINTED.findall(code)]
        if expected:
            assert printed.getvalue().splitlines() == expected


def test_the_reference_has_every_public_name():
    listed = re.findall(r"^   (\w+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(suslov_fast.__all__)


def test_the_citation_is_of_this_version():
    text = (DOCS.parent / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", text, re.MULTILINE).group(1) == suslov_fast.__version__
    for key in ("cff-version", "message", "title", "authors", "license", "preferred-citation"):
        assert re.search(rf"^{key}:", text, re.MULTILINE)


@pytest.mark.parametrize("path", EXAMPLES, ids=name)
def test_an_example_is_a_title_a_paragraph_and_a_script(path):
    """They run when the pages are built; here only what they are made of."""
    text = path.read_text(encoding="utf-8")
    compile(text, path.name, "exec")
    assert re.match(r'"""\n(.+)\n=+\n\n', text)


def test_links_between_pages_lead_somewhere():
    for path in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)[^)]*\)", path.read_text(encoding="utf-8")):
            if "gallery" not in target and not target.startswith("http"):
                assert (path.parent / target).exists(), (path.name, target)
