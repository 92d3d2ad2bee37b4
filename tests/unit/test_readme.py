"""What the README tells a reader to type is there, and its first case is one."""

import re
from pathlib import Path

from granpipe.case.reader import load_case

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "docs/how-to/install.md", ROOT / "CHANGELOG.md"]


def test_the_first_case_is_valid_and_short(tmp_path: Path) -> None:
    block = re.search(r"```yaml[^\n]*\n(.*?)```", PAGES[0].read_text(), re.DOTALL)
    assert block is not None
    text = block.group(1)
    (tmp_path / "first.yaml").write_text(text)
    assert load_case(tmp_path / "first.yaml").name == "first"
    assert len(text.splitlines()) <= 20


def test_every_target_of_make_that_is_named_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for page in PAGES:
        named = set(re.findall(r"^make ([a-z-]+)|`make ([a-z-]+)", page.read_text(), re.MULTILINE))
        assert {one or other for one, other in named} <= targets, page.name


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_packages_of_the_installation_page_are_those_that_setup_installs() -> None:
    setup = (ROOT / ".ci/setup").read_text()
    wanted = set(re.findall(r"^lib\S+\s+(\S+)$", setup, re.MULTILINE)) | {"python3-venv", "liggghts"}
    command = re.search(r"apt-get install --no-install-recommends ((?:.|\\\n)*?)\n```", PAGES[1].read_text())
    assert command is not None
    assert set(command.group(1).replace("\\\n", " ").split()) == wanted


def test_the_overview_of_the_validation_names_every_page_of_its_folder() -> None:
    folder = ROOT / "docs/validation"
    named = set(re.findall(r"\]\((\w+\.md)\)", (folder / "index.md").read_text()))
    assert named == {page.name for page in folder.glob("*.md")} - {"index.md"}
