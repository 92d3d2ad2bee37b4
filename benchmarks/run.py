"""Snapshot reading and deposit against their peers, all in one run; writes docs/validation/benchmarks.md.

The peers live in environments of their own (KonigCell needs numpy < 2), made on first use under
~/.cache/granpipe/benchmarks and kept.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests"))
from fakes.analytic_flow import binary_snapshot, table, text_snapshot  # noqa: E402

from granpipe.dem.dump import read_snapshot  # noqa: E402
from granpipe.field import Box, Grid  # noqa: E402
from granpipe.homogenize.deposit import deposit  # noqa: E402

CACHE = Path.home() / ".cache" / "granpipe" / "benchmarks"
PEERS = {"readers": ["ovito", "pandas", "pyarrow"], "konigcell": ["konigcell", "numpy<2"]}
RADIUS, WALL, HEIGHT = 0.03, 1.156, 5.9  # the test reactor, with the particles of the paper's mean size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--particles", type=int, default=134_000)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "benchmarks.md")
    options = parser.parse_args()
    position, velocity, radius = random_spheres(options.particles)
    with tempfile.TemporaryDirectory() as folder:
        reading = readers(Path(folder), position, velocity, radius, options.repetitions)
        depositing = deposits(Path(folder), position, velocity, radius, options.repetitions)
    text = page(options.particles, reading, depositing)
    options.out.parent.mkdir(exist_ok=True)
    options.out.write_text(text)
    print(text)


def random_spheres(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    distance, angle = (WALL - RADIUS) * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    height = rng.uniform(RADIUS, HEIGHT - RADIUS, count)
    position = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), height])
    return position, rng.normal(size=(count, 3)), np.full(count, RADIUS)


def environment(name: str) -> Path:
    """Python of a peer's environment, made where it is missing."""
    folder = CACHE / name
    python = folder / "bin" / "python"
    if not (folder / "ready").exists():
        print(f"making the environment {folder} ({', '.join(PEERS[name])}) …", file=sys.stderr)
        venv.create(folder, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PEERS[name]], check=True)
        (folder / "ready").touch()
    return python


def peer(name: str, script: str, *arguments: object) -> dict:
    """What a peer's script prints."""
    command = [environment(name), HERE / script, *map(str, arguments)]
    one_thread = os.environ | {"QT_QPA_PLATFORM": "offscreen", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=one_thread)
    if done.returncode:
        sys.exit(f"{script} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def best(task: Callable[[], object], repetitions: int) -> float:
    """Shortest time of several [s], after one that fills caches and compiles."""
    task()
    times = []
    for _ in range(repetitions):
        begun = time.perf_counter()
        task()
        times.append(time.perf_counter() - begun)
    return min(times)


def readers(folder: Path, position, velocity, radius, repetitions: int) -> list[tuple[str, float, float]]:
    """(name, seconds, megabytes) of reading one snapshot."""
    values = table(np.arange(1, len(radius) + 1), position, velocity, radius)
    box = np.array([[-2, 2], [-2, 2], [-1, 8.0]])
    binary, text = folder / "snapshot.bin", folder / "snapshot.txt"
    binary.write_bytes(binary_snapshot(1, box, values, 2))
    text.write_bytes(text_snapshot(1, box, values))
    seconds = {
        "granpipe, binary": best(lambda: read_snapshot(binary), 4 * repetitions),
        "granpipe, text": best(lambda: read_snapshot(text), repetitions),
    }
    for name, result in peer("readers", "peer_readers.py", binary, text, repetitions).items():
        assert result["particles"] == len(radius), f"{name} read {result['particles']} particles"
        seconds[name] = result["seconds"]
    return [(n, s, (binary if "binary" in n else text).stat().st_size / 1e6) for n, s in seconds.items()]


def deposits(folder: Path, position, velocity, radius, repetitions: int) -> list[tuple[str, float, float | None]]:
    """(name, particles per second, RMS error of the cells in % of their mean content) of depositing."""
    grid = Grid.covering(WALL, 0, HEIGHT, RADIUS / 2)
    exact = deposit(position[:20_000], radius[:20_000], velocity[:20_000], grid, points=24).volume
    rows = []

    def add(name: str, method: Callable[[slice], np.ndarray]) -> None:
        seconds = best(lambda: method(slice(None)), repetitions)
        error = np.sqrt(np.mean((method(slice(20_000)) - exact) ** 2)) / exact.mean()
        rows.append((name, len(radius) / seconds, 100 * error))

    def rings(part: slice) -> np.ndarray:
        return deposit(position[part], radius[part], velocity[part], grid).volume

    def centres(part: slice) -> np.ndarray:
        r = np.hypot(position[part, 0], position[part, 1])
        volume = 4 / 3 * np.pi * radius[part] ** 3
        at = np.searchsorted(grid.r_edges, r) - 1 + grid.shape[1] * (position[part, 2] // grid.cell).astype(int)
        return np.bincount(at, volume, grid.shape[0] * grid.shape[1]).reshape(grid.shape)

    add("granpipe, rings", rings)
    add("histogram of centres", centres)
    some = min(5000, len(radius))
    side = 2 * int(np.ceil(WALL / grid.cell))
    reach = (-side / 2 * grid.cell, side / 2 * grid.cell)
    space = Box.within(reach, reach, (0, HEIGHT), grid.cell, flat=False, cut=True)
    seconds = best(lambda: deposit(position, radius, velocity, space), 1)
    rows.append(("granpipe, 3-D voxels", len(radius) / seconds, None))
    np.savez(
        folder / "spheres.npz",
        position=position[:some],
        radius=radius[:some],
        limits=[reach, reach, (0, HEIGHT)],
        cells=[side, side, grid.shape[0]],
    )
    result = peer("konigcell", "peer_konigcell.py", folder / "spheres.npz")
    rows.append(("KonigCell, 3-D voxels", some / result["seconds"], None))
    return rows


_DECISIONS = """\
## Why one compiled kernel, and no pandas

Until 2026-11-28 there were two kernels, in numpy and compiled by numba, which gave the same to rounding. They were
compared on dumps of 72,000 spheres of radius 1 cm (`tests/fakes/analytic_flow.py`), whole `granpipe homogenize`,
processor seconds on a machine that was busy with other work:

| field | cells | numpy | numba |
|---|---|---|---|
| rings, 12 snapshots, by displacement | d/4 | 26.5 | 13.8 |
| plane x–z, 12 snapshots, by displacement | d/4 | 76.4 | 19.9 |
| rings, 3 snapshots, by velocity | d/4 | 2.8 | 2.4 |
| plane x–z, 3 snapshots, by velocity | d/4 | 7.0 | 2.2 |
| space, 3 snapshots, by velocity | d/2 | 9.1 | 3.6 |

numba costs 0.8 s to import, 3 to 5 s once per installation to compile, and 208 MB on disk (numba and llvmlite). The
numpy kernels, 250 lines, are gone.

pandas reads text dumps 9 times as fast (above), 2.7 times on the busy machine (446 against 1,226 ms for 134,000
spheres). It is no dependency: it takes 84 MB, and its import alone cost 2 s there, as much as it saves on three
snapshots of that size. Who has many should dump binary, which is read in 2 ms.
"""


def page(count: int, reading: list, depositing: list) -> str:
    """The table as Markdown."""
    first, kernel = reading[0][1], depositing[0][1]
    lines = [
        "# Benchmarks",
        "",
        f"Made by `make benchmarks` on {datetime.now(UTC):%Y-%m-%d}: {machine()}. One run, one core, everything from",
        f"the page cache, best of several; {count} spheres of radius {RADIUS} m in a cylinder of {WALL} × {HEIGHT} m.",
        "Times change from run to run and machine to machine; the ratios hold better.",
        "",
        "## Reading one snapshot (nine columns)",
        "",
        "| reader | file [MB] | time [ms] | time / granpipe, binary |",
        "|---|---|---|---|",
        *(f"| {name} | {size:.1f} | {1e3 * s:.1f} | {s / first:.1f} |" for name, s, size in reading),
        "",
        f"## Deposit onto a grid of cells of a quarter of the diameter ({RADIUS / 2} m)",
        "",
        "granpipe deposits volume and the flow through all faces with three points per cell height; KonigCell (volume",
        "on Cartesian voxels of the same edge, one worker) and the histogram (volume at the centres) volume alone. The",
        "error is that of the cells' volume against 24 points, RMS over all cells, relative to their mean.",
        "",
        "| method | particles/s | rate / granpipe, rings | error [%] |",
        "|---|---|---|---|",
        *(
            f"| {name} | {rate:,.0f} | {rate / kernel:.3g} | {'–' if e is None else f'{e:.2g}'} |"
            for name, rate, e in depositing
        ),
        "",
        _DECISIONS.rstrip(),
        "",
    ]
    return "\n".join(lines)


def machine() -> str:
    model = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.split(":")[1].strip()
            break
    return f"{os.cpu_count()} cores, {model}, Python {platform.python_version()}, numpy {np.__version__}"


if __name__ == "__main__":
    main()
