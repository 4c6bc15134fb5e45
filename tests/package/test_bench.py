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


def test_a_comparison_of_nothing_fails(capfd):
    assert compare.main([str(results.BENCH.parent), "-k", "no-case-has-this-name"]) == 2
    assert capfd.readouterr().out.splitlines()[-1] == "no case was compared"


@pytest.mark.compiled
@pytest.mark.slow
def test_a_case_that_fails_in_one_tree_is_listed(capfd, monkeypatch, tmp_path):
    """A revision without `flow`, beside one that has it: the cases that need it, and no other."""
    monkeypatch.setattr(compare, "TURN", 0.005)
    here, start = results.BENCH.parent, tmp_path / "suslov_fast" / "__init__.py"
    start.parent.mkdir()
    for path in (here / "suslov_fast").iterdir():
        if path.name != start.name:
            (start.parent / path.name).symlink_to(path)
    text = (here / "suslov_fast" / start.name).read_text(encoding="utf-8")
    start.write_text(text + '\ndel MODULE_OF["flow"]\n', encoding="utf-8")
    for trees, named in (((tmp_path, here), "A"), ((here, tmp_path), "B")):
        assert compare.main([*map(str, trees), "-k", "calls-f", "--threshold", "100"]) == 2
        assert capfd.readouterr().out.endswith(f"1 failed in {named}\n  calls-flow\n")
