"""The tools that report and compare benchmarks, on small problems: nothing is timed."""

import compare
import floors
import pytest
import report
import results
import tables
from cases import CASES


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
    assert {case.table for case in CASES} == {found[0] for found in tables.TABLE.findall(page)}
    names = [case.name for case in CASES]
    assert len(set(names)) == len(CASES)
    assert not any(set(" ,[]") & set(name) for name in names)
    assert page.count("<!-- floors -->") == 1
    assert {name for floor in floors.ROWS for name in floor[1:3]} <= set(names)


@pytest.mark.compiled
@pytest.mark.slow
def test_two_revisions_are_compared(capfd, monkeypatch):
    """The working tree with itself, with a tiny threshold, in short turns."""
    monkeypatch.setattr(compare, "TURN", 0.005)
    here, case = str(results.BENCH.parent), ["--quick", "-k", "quantities-energy"]
    assert compare.main([here, *case, "--threshold", "1e-9"]) == 1
    assert "1 slower than allowed\n  quantities-energy" in capfd.readouterr().out
    assert compare.ratios([1.0, 2.0, 4.0], [2.0, 2.0, 6.0]) == (1.5, 2.0)
    with pytest.raises(SystemExit, match="no such revision"):
        compare.main([here, "nowhere-at-all"])
