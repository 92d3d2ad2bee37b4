"""What the terminal says when a run has ended: where things are, and what can be done with them."""

from __future__ import annotations

from pathlib import Path

from fakes.results_folder import GATE, results

from granpipe.pipeline.closing import closing_text


def test_a_good_field_is_followed_by_every_way_that_its_files_offer(tmp_path: Path) -> None:
    folder = results(tmp_path)
    text = closing_text(folder)
    assert f"cd {folder}/comsol; comsol compile import_comsol.java; comsol batch " in text
    assert f"python {folder}/comsol/import_comsol.py flow.mph" in text
    assert "docs/how-to/comsol.md" in text
    assert f"granpipe.load_result('{folder}')" in text
    assert "other-programs" not in text
    (folder / "openfoam").mkdir()
    assert f"openfoam/ (for OpenFOAM) in {folder}: docs/how-to/other-programs.md" in closing_text(folder)


def test_a_folder_with_a_space_can_be_pasted_into_a_shell(tmp_path: Path) -> None:
    (tmp_path / "my results").mkdir()
    assert f"cd '{tmp_path}/my results/comsol';" in closing_text(results(tmp_path / "my results"))


def test_a_marked_field_is_not_followed_by_ways_to_use_it(tmp_path: Path) -> None:
    text = closing_text(results(tmp_path, quality=[GATE, GATE | {"value": 0.4, "passed": False}]))
    assert "1 of 2 passed; marked" in text
    assert "COMSOL" not in text
    assert "load_result" not in text


def test_a_field_in_space_is_followed_by_its_own_ways(tmp_path: Path) -> None:
    """It has no program for COMSOL, and three coordinates."""
    folder = results(tmp_path, figures={"conserving_changes": 0.0})
    (folder / "comsol" / "import_comsol.java").unlink()
    text = closing_text(folder)
    assert "import_comsol" not in text
    assert f"load the files of {folder}/comsol as docs/how-to/vessels-in-space.md says" in text
    assert ".field.velocity(x, y, z)" in text
