"""A case from a stranger can do nothing but fail: status 2, one line, in little time and memory, and no trace left."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner
from fuzz.limits import bounded

from granpipe.cli import main

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 10)}]\n" for i in range(12)
)

STRANGE = {
    "python object": ("name: tiny", "name: !!python/object/apply:os.system ['touch trace']"),
    "python name": ("name: tiny", "name: !!python/name:os.system"),
    "shell in a name": ("name: tiny", "name: $(touch trace)"),
    "shell in an obstacle": (
        "material:",
        '  obstacles: {"x\\nshell touch trace": [[0, 4], [1, 4], [1, 5]]}\nmaterial:',
    ),
    "shell in a number": ("2000 kg/m^3", '"2000\\nshell touch trace"'),
    "deck variable": ("diameter: 2 cm", "diameter: ${trace}"),
    "template": ("name: tiny", "name: '{{ 7 * 7 }}'"),
    "path in the name": ("name: tiny", "name: ../../trace"),
    "absolute path": ("name: tiny", "name: /tmp/trace"),
    "hidden name": ("name: tiny", "name: .store"),
    "power tower": ("diameter: 2 cm", "diameter: 9**9**9 m"),
    "huge number": ("diameter: 2 cm", "diameter: " + "9" * 5000),
    "alias bomb": ("name: tiny", BOMB + "name: tiny"),
    "deep nesting": ("name: tiny", "name: " + "[" * 20_000),
    "grid without end": ("homogenize: {", "homogenize: {cell: 1e-9, "),
    "particles without number": ("diameter: 2 cm", "diameter: 1e-9"),
    "steps without end": ("max_time: 1.2 s", "max_time: 1e300"),
    "density near zero": ("2000 kg/m^3", "1e-308 kg/m^3"),
    "outlet of no width": ("[6, 0]]", "[1e-9, 0]]"),
    "sizes between the classes": ("2 cm}", "{normal: {mean: 2 cm, std: 1e-9 cm, min: 1 cm, max: 3.1 cm}}}"),
    "not UTF-8": ("name: tiny", "name: \udcff\udcfe"),
}


def refused(folder: Path) -> str:
    """What is said of a case that must be refused; checks how it ends."""
    before = set(folder.rglob("*"))
    with bounded() as clock:
        clock()
        done = CliRunner().invoke(main, ["run", str(folder / "tiny.yaml"), "--results", str(folder / "results")])
    assert (done.exit_code, done.stdout) == (2, ""), done.output
    assert len(done.stderr.splitlines()) == 1
    assert set(folder.rglob("*")) == before
    return done.stderr


@pytest.mark.parametrize("name", STRANGE)
def test_a_hostile_case_only_fails(tiny: Path, name: str) -> None:
    old, new = STRANGE[name]
    text = tiny.read_text()
    assert old in text
    tiny.write_bytes(text.replace(old, new, 1).encode(errors="surrogateescape"))
    assert "tiny.yaml" in refused(tiny.parent)


def test_a_case_of_a_gigabyte_is_not_read(tiny: Path) -> None:
    os.truncate(tiny, 10**9)
    assert "larger than 1 MB" in refused(tiny.parent)


def test_a_case_that_never_ends_is_not_read(tiny: Path) -> None:
    tiny.unlink()
    tiny.symlink_to("/dev/zero")
    assert "a device, not a regular file" in refused(tiny.parent)
