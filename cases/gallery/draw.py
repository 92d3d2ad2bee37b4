"""Writes the drawings and cases of the gallery: `python cases/gallery/draw.py`. Lengths in mm, particles of 20 mm."""

from pathlib import Path

Points = list[tuple[float, float]]

VESSELS: dict[str, tuple[str, Points, list[Points], str]] = {
    "axis_cone": (
        "Silo with a cone on its axis",
        [(130, 260), (130, 120), (110, 60), (110, 0)],
        [[(0, 190), (28, 140), (0, 120)]],
        "",
    ),
    "blast_furnace": (
        "Shaft of a blast furnace: throat, shaft, belly, bosh",
        [(110, 400), (110, 370), (150, 180), (150, 140), (110, 40), (110, 0)],
        [],
        "",
    ),
    "ledged_bulge": (
        "Pipe with a bulge between two ledges",
        [(110, 300), (110, 200), (150, 200), (150, 110), (110, 110), (110, 0)],
        [],
        "",
    ),
    "free_ring": (
        "Ring that hangs free in a pipe",
        [(165, 140), (165, 0)],
        [[(50, 70), (57, 85), (64, 70), (57, 55)]],
        "",
    ),
    "annular_outlet": (
        "Pipe with a core that leaves an annular outlet",
        [(130, 240), (130, 0)],
        [[(0, 130), (28, 90), (28, 0), (0, 0)]],
        "",
    ),
    "pebble_funnel": (
        "Pebble bed with a funnel of 45 degrees",
        [(150, 220), (150, 120), (70, 40), (70, 0)],
        [],
        "",
    ),
    "flat_bottom": (
        "Flat-bottomed silo",
        [(130, 220), (130, 40), (70, 40), (70, 0)],
        [],
        "dem: {max_time: 10 s}  # its funnel leans: one filling of eight was 14 % off-axis after 7.4 s\n",
    ),
    "smooth_cone": (
        "Mass-flow hopper with a wall friction of 0.1",
        [(130, 300), (130, 220), (70, 40), (70, 0)],
        [],
        "contact: {wall: {friction: 0.1}}\n",
    ),
}


def main() -> None:
    """Write `NAME.csv` and `NAME.yaml` of every vessel beside this file."""
    folder = Path(__file__).parent
    for name, (title, wall, obstacles, more) in VESSELS.items():
        closed = [[*obstacle, obstacle[0]] for obstacle in obstacles]
        lines = ["\n".join(f"{r:g}, {z:g}" for r, z in line) for line in (wall, *closed)]
        (folder / f"{name}.csv").write_text("r, z\n" + "\n\n".join(lines) + "\n")
        (folder / f"{name}.yaml").write_text(
            f"# {title}. Drawn by draw.py.\n"
            f"name: {name}\n"
            f"outline: {{file: {name}.csv, unit: mm}}\n"
            "material: {density: 2500 kg/m^3, size: {diameter: 20 mm}}\n"
            f"flow_rate: 100 kg/h\n{more}"
        )


if __name__ == "__main__":
    main()
