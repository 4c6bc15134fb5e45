"""The tools that report and compare benchmarks, on small problems: nothing is timed."""

import cases
import compare
import floors
import pytest
import report
import results
import tables


def test_the_readme_and_the_page_show_the_stored_results():
    files = (report.FOLDER / f"{name}.json" for name in ("benchmarks", "motions"))
    stored = results.Results(*map(results.load, files))
    text = report.README.read_text(encoding="utf-8")
    assert tables.replace(text, tables.page(stored, "readme.md")) == text
    page = (report.FOLDER / "tables.md").read_text(encoding="utf-8")
    assert page == tables.page(stored, "tables.md")
    with pytest.raises(ValueError, match="expected one"):
        tables.replace("no markers", "new")


def test_each_case_has_a_place_in_the_page_and_a_name_of_its_own():
    page = (results.BENCH / "pages" / "tables.md").read_text(encoding="utf-8")
    assert {case.table for case in cases.every()} == {
        found[0] for found in tables.TABLE.findall(page)
    }
    names = {*cases.places()}
    assert len(names) == len(cases.every())
    assert not any(set(" ,[]") & set(name) for name in names)
    assert page.count("<!-- floors -->") == 1
    assert {name for floor in floors.ROWS for name in floor[1:3]} <= names


@pytest.fixture
def compared(capfd, monkeypatch):
    """A function that compares two folders in short turns, and returns the status and the words."""
    monkeypatch.setattr(compare, "TURN", 0.005)

    def run(*arguments):
        return compare.main([*map(str, arguments)]), capfd.readouterr().out

    return run


HERE = results.BENCH.parent


@pytest.mark.compiled
@pytest.mark.slow
def test_two_revisions_are_compared(compared):
    """The working tree with itself, with a tiny threshold."""
    status, text = compared(HERE, "-k", "calls-exact", "--threshold", "1e-9")
    assert status == 1
    assert "1 slower than allowed\n  calls-exact" in text
    assert compare.ratios([1.0, 2.0, 4.0], [2.0, 2.0, 6.0]) == (1.5, 2.0)
    with pytest.raises(SystemExit, match="2"):
        compare.main([str(HERE), "nowhere-at-all"])


def test_a_comparison_of_nothing_fails(compared):
    """Of no case, of which the pools do not start, too."""
    status, text = compared(HERE, "-k", "no-case-has-this-name")
    assert (status, text.splitlines()[-1]) == (2, "no case was compared")
