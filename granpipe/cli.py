"""The command line: the only place that prints and exits. Every command imports what it needs when it runs."""

from __future__ import annotations

import errno
import math
import signal
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import click

from granpipe import __version__
from granpipe.console import Console
from granpipe.errors import GranpipeError
from granpipe.system.surroundings import prepare

if TYPE_CHECKING:
    from granpipe.case.reader import CaseFile
    from granpipe.pipeline.gates import Gate
    from granpipe.sweep.folder import Folder

INTERRUPTED = 130
QUALITY_FAILED = 4

LEAST_TIME_STEP, MOST_TIME_STEP = 1e-12, 10.0
"""Time steps of particle simulations [s], from atoms to boulders; others are slips of the pen."""

MOST_ANGLE_ERROR = 10.0
"""Largest standard error of an angle of repose [°]; with all frictions the angles of heaps are 10° to 42°."""

LONG = 3 * 3600.0
"""Forecast [s] above which somebody at a terminal is asked before the work."""

MOVED = {"status": "sweep status", "cancel": "sweep cancel", "reduce": "sweep table", "points": "sweep points"}
"""Commands that had another name before, with the one that they have now."""


class _Group(click.Group):
    """Turns the failures that granpipe explains into one message and an exit status."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except GranpipeError as error:
            click.echo(f"granpipe: {error}", err=True)
            sys.exit(error.exit_status)
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not change the exit status
            click.echo("granpipe: interrupted; run the same command again to continue", err=True)
            sys.exit(INTERRUPTED)
        except BrokenPipeError:
            sys.exit(0)
        except OSError as error:
            remedy = (
                "free some disk space and run the same command again: it resumes"
                if error.errno == errno.ENOSPC
                else "check the folder and its permissions, or choose another one"
            )
            click.echo(f"granpipe: {error.filename or 'a file'}: {error.strerror}; {remedy}", err=True)
            sys.exit(GranpipeError.exit_status)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] in MOVED:
            ctx.fail(f"`granpipe {args[0]}` is now `granpipe {MOVED[args[0]]}`")
        return super().resolve_command(ctx, args)


_DRAWN = ("overview", "packing", "u", "w", "speed", "streamlines", "error")
_DRAWN_FIELDS = ("pressure", "shear_rate", "granular_temperature", "coordination", "mixing_index", "age", "sensitivity")


class _SweepGroup(click.Group):
    """Says how to write `granpipe sweep FILE` now."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and self.get_command(ctx, args[0]) is None and Path(args[0]).exists():
            ctx.fail(f"`granpipe sweep {args[0]}` is now `granpipe sweep run {args[0]}`")
        return super().resolve_command(ctx, args)


class _Quantity(click.ParamType):  # type: ignore[type-arg]
    """A number with its unit; the command gets it in SI."""

    def __init__(self, dimension: Literal["number", "length", "time", "angle"], positive: bool = False) -> None:
        self.name, self.positive = dimension, positive

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        from granpipe.case import units
        from granpipe.case.yamlfile import plain_value

        try:
            number = units.in_si(plain_value(str(value)), getattr(units, self.name.upper()))
        except units.UnitError as error:
            self.fail(str(error), param, ctx)
        if self.positive and not number > 0:
            self.fail(f"{value} must be above 0", param, ctx)
        return number


class _Place(click.ParamType):  # type: ignore[type-arg]
    """Two lengths with a comma between them; the command gets them in SI."""

    name = "x,y"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        ends = [_Quantity("length").convert(text, param, ctx) for text in str(value).split(",")]
        if len(ends) != 2:
            self.fail(f"{value}: write two lengths, such as 0.5,0.5", param, ctx)
        return ends[0], ends[1]


class _Level(click.ParamType):  # type: ignore[type-arg]
    """`z=4.4`: a height; the command gets it in metres."""

    name = "z=height"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        key, sign, text = str(value).partition("=")
        if key.strip() != "z" or not sign:
            self.fail(f"{value}: write it as z=HEIGHT, such as z=4.4 or z=440cm", param, ctx)
        return _Quantity("length").convert(text, param, ctx)


class _Cut(click.ParamType):  # type: ignore[type-arg]
    """`x=0.1`: an axis and a place on it; the command gets it in metres."""

    name = "axis=place"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, float]:
        axis, sign, text = str(value).partition("=")
        if axis.strip() not in ("x", "y", "z") or not sign:
            self.fail(f"{value}: write it as x=PLACE, y=PLACE or z=PLACE, such as z=0.1 or z=10cm", param, ctx)
        return axis.strip(), _Quantity("length").convert(text, param, ctx)


class _Picture(click.ParamType):  # type: ignore[type-arg]
    """The file of a picture: matplotlib would take its kind from another ending, or add one."""

    name = "file.png"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if (path := Path(value)).suffix != ".png":
            self.fail(f"{value}: pictures are PNG files; give a name that ends in .png", param, ctx)
        return path


class _Override(click.ParamType):  # type: ignore[type-arg]
    """`key=value`: a dotted key of the case and its value as YAML."""

    name = "key=value"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        key, sign, text = str(value).partition("=")
        if not (key and sign):
            self.fail(f"{value}: write it as --set key=value, such as --set dem.seed=2", param, ctx)
        return key, text


def _as_mapping(_: click.Context, __: click.Parameter, pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    return dict(pairs)


_PATH = click.Path(path_type=Path)
_CASE = click.argument("case", type=_PATH)
_FILE = click.argument("file", type=_PATH)
_SET = click.option("--set", "overrides", multiple=True, type=_Override(), callback=_as_mapping,
                    help="Override one key of the case; may be repeated.")  # fmt: skip
_RESULTS = click.option("--results", type=_PATH, default=Path("results"), show_default=True, help="Results folder.")
_ON = click.option("--on", type=click.Choice(["local", "slurm"]), default="local", show_default=True,
                   help="Run here, or as Slurm jobs.")  # fmt: skip
_CORES = click.option("--cores", type=click.IntRange(1), help="Cores to use here; default: all available.")
_CLUSTER = click.option("--cluster", type=_PATH, default=Path("cluster.yaml"), show_default=True,
                        help="What each job requests from the cluster.")  # fmt: skip


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="granpipe")
def main() -> None:
    """Granular flow in vessels, as a velocity field for multiphysics programs.

    Exit status: 0 done; 2 the case or the command line is wrong; 3 a program or a file failed; 4 done, but a quality
    gate failed; 130 interrupted.
    """
    prepare()
    signal.signal(signal.SIGTERM, _interrupt)


@main.command()
@_CASE
@_SET
@_RESULTS
@click.option("--total-error", type=_Quantity("number", positive=True), metavar="ERROR",
              help="Use the cheapest settings that the study rates within ERROR, such as 5%, and end when noise and "
                   "systematic error make it.")  # fmt: skip
@click.option("--yes", is_flag=True, help="Begin without asking, however long it will take.")
def run(case: Path, overrides: Mapping[str, str], results: Path, total_error: float | None, yes: bool) -> None:
    """Run CASE: compute the field, COMSOL files and figures.

    An unchanged case is not run again; a changed one repeats only the stages that depend on the change. Somebody at a
    terminal is asked first where the forecast is above three hours.
    """
    from granpipe.pipeline.closing import closing_text
    from granpipe.pipeline.run import run_case
    from granpipe.study.recommend import recommend

    file, chosen = _read(case, overrides), None
    if total_error is not None:
        chosen = recommend(file, results, total_error)
        file = chosen.file
        click.echo(chosen.expected)
    with Console() as console:

        def agreed(seconds: float) -> bool:
            asked = seconds > LONG and not yes and sys.stdin.isatty() and sys.stderr.isatty()
            return not asked or console.ask("begin?")

        outcome = run_case(file, results, console, agreed=agreed)
    click.echo(f"results in {outcome.folder}" if outcome.made else f"nothing to do: {outcome.folder} is up to date")
    if chosen is not None:
        click.echo(chosen.obtained(outcome.folder))
    click.echo(closing_text(outcome.folder))
    _end(outcome.failed)


@main.command()
@_CASE
@_SET
@click.option("--picture", type=_Picture(), help="PNG file to draw the plan into; default: CASE with .plan.png.")
def plan(case: Path, overrides: Mapping[str, str], picture: Path | None) -> None:
    """Show what a run of CASE would do, leave out and cost.

    A picture of the vessel shows sections, openings, free surfaces to be expected, and what will be simulated.
    """
    from granpipe.pipeline.plan_picture import draw_plan
    from granpipe.pipeline.run import plan_case
    from granpipe.planning.make import model_plans, other_rheology
    from granpipe.planning.text import plan_text
    from granpipe.planning.vessel_text import planned_vessel_text
    from granpipe.system.cores import usable_cores
    from granpipe.system.rates import known_rates

    file, cores = _read(case, overrides), usable_cores()
    for note in (*file.notes, *file.library):
        click.echo(f"note: {note}")
    made = plan_case(file, cores)
    click.echo(plan_text(made, model_plans(file.case, cores), other_rheology(file.case, cores), known_rates()))
    click.echo(f"\n{planned_vessel_text(made)}")
    click.echo(draw_plan(made, picture or case.with_suffix(".plan.png")))


@main.command()
@_CASE
@_SET
def check(case: Path, overrides: Mapping[str, str]) -> None:
    """Check whether CASE is valid, without running it."""
    from granpipe.pipeline.run import plan_case
    from granpipe.planning.vessel_text import planned_vessel_text
    from granpipe.system.cores import usable_cores

    file = _read(case, overrides)
    made = plan_case(file, usable_cores())
    click.echo(planned_vessel_text(made))
    for warning in (*file.notes, *file.library, *made.warnings, *made.breaches):
        click.echo(f"note: {warning}")
    click.echo(f"{case}: valid")


@main.command()
@_FILE
@click.option("--unit", default="", help="Unit of the drawing, such as mm; needed where the file does not tell.")
@click.option("--axis", type=float, help="Where the axis lies, in the drawing's unit; found unless given.")
@click.option("--up", type=click.Choice(["x", "-x", "y", "-y", "z", "-z"]), help="Direction that points up.")
@click.option("--tolerance", type=float, help="How far a curve may lie off the straight lines that stand for it.")
@click.option("--picture", type=_Picture(), help="PNG file to draw what was found; default: FILE with .outline.png.")
def outline(
    file: Path, unit: str, axis: float | None, up: str | None, tolerance: float | None, picture: Path | None
) -> None:
    """Show the vessel in a drawing: size, picture, YAML for a case.

    Reads DXF, CSV, COMSOL meshes (.mphtxt), STEP, BREP, STL and OBJ. Instead of pasting, a case can name the drawing:
    `outline: {file: silo.dxf}`.
    """
    from granpipe.pipeline.drawing import drawn_vessel

    path = picture or file.with_name(f"{file.name}.outline.png")
    vessel = drawn_vessel(file, path, unit, axis, up or "", tolerance)
    click.echo(vessel.text, err=True)
    _tell(f"note: {note}" for note in vessel.notes)
    click.echo(f"picture in {path}", err=True)
    click.echo(vessel.yaml, nl=False)


@main.command()
@click.argument("path", type=_PATH, default=Path("case.yaml"))
def init(path: Path) -> None:
    """Write a commented starter case to PATH."""
    from granpipe.case.reader import starter_case

    try:
        with path.open("x") as file:
            file.write(starter_case())
    except FileExistsError:
        _fail(f"{path} exists already; choose another name")
    except OSError as error:
        _fail(f"{path}: cannot be written ({error.strerror})")
    click.echo(f"wrote {path}; next: granpipe plan {path}")


@main.command()
def materials() -> None:
    """List the library of materials, with sources.

    A case uses one by `material: {name: glass beads, …}`.
    """
    from granpipe.case.library import library_text

    click.echo(library_text())


@main.command()
def schema() -> None:
    """Print the JSON Schema of a case, for editors."""
    from granpipe.case.reader import schema_json

    click.echo(schema_json(), nl=False)


@main.command()
def doctor() -> None:
    """Check that everything a run needs is installed."""
    from granpipe.system.doctor import check as check_all
    from granpipe.system.doctor import findings_text

    findings = check_all()
    click.echo(findings_text(findings))
    if any(finding.found is None for finding in findings):
        sys.exit(GranpipeError.exit_status)


@main.command()
def calibrate() -> None:
    """Measure the speed of this machine, in half a minute.

    `granpipe plan` then forecasts times for this machine.
    """
    from granpipe.pipeline.calibrate import calibrate as measure
    from granpipe.system.doctor import require

    require("gmsh library")
    with Console() as console:
        rates = measure(console)
    click.echo(rates.text)


@main.command()
@_RESULTS
def clean(results: Path) -> None:
    """Delete intermediate stages; the results stay."""
    from granpipe.system.store import Store

    store = results / ".store"
    if not store.is_dir():
        click.echo(f"nothing to do: {store} does not exist")
        return
    freed, foreign = Store(store).clear()
    click.echo(f"freed {freed / 1e6:.1f} MB; the next run starts from the beginning")
    _tell(f"kept {folder}: granpipe has not written all that is in it" for folder in foreign)


@main.command()
@click.argument("result", type=_PATH)
@click.option("--flow", required=True, metavar="FLOW", help="Flow rate, such as 2[m^3/h] or '1 t/h'.")
@click.option("--out", required=True, type=_PATH, help="Folder for the new files.")
def scale(result: Path, flow: str, out: Path) -> None:
    """Export RESULT for another flow rate, without a new run.

    RESULT is the results folder of a completed run.
    """
    from granpipe.pipeline.scale import scale_results

    scaled = scale_results(result, _read_result(result, {"flow_rate": flow}).case, out)
    _tell(f"warning: {note}" for note in scaled.notes)
    click.echo(f"scaled results in {out}")
    _end(scaled.failed)


@main.command()
@click.argument("result", type=_PATH)
@click.option("--what", default="overview", show_default=True, metavar="NAME",
              type=click.Choice(_DRAWN + _DRAWN_FIELDS),
              help=f"What to draw on the half section of the vessel: {', '.join(_DRAWN)}; or what else "
                   f"the field holds: {', '.join(_DRAWN_FIELDS)}.")  # fmt: skip
@click.option("--profile", type=_Level(), metavar="z=HEIGHT",
              help="Draw the profile across a level instead, such as z=4.4 or z=440cm.")  # fmt: skip
@click.option("--cut", type=_Cut(), metavar="AXIS=PLACE",
              help="Draw the speed on a cut through a field in space instead, such as x=0 or z=10cm.")  # fmt: skip
@click.option("--out", type=_Picture(), help="PNG file to write; default: named after RESULT, in the current folder.")
@click.option("--show", is_flag=True, help="Open the picture with the viewer of the desktop.")
def plot(
    result: Path, what: str, profile: float | None, cut: tuple[str, float] | None, out: Path | None, show: bool
) -> None:
    """Draw one picture of RESULT, at the flow rate of the process.

    RESULT is the results folder of a completed run or of homogenize.
    """
    from granpipe.pipeline.plot import plot_result

    path = plot_result(result, what, profile, out, cut)
    click.echo(f"picture in {path}")
    if show and click.launch(str(path)) != 0:
        click.echo(f"no viewer could be started; open {path} yourself", err=True)


@main.command()
@click.argument("one", type=_PATH)
@click.argument("other", type=_PATH)
@click.option("--tolerance", type=_Quantity("number", positive=True), default="5 %", show_default=True,
              help="Largest difference at which two fields agree.")  # fmt: skip
def compare(one: Path, other: Path, tolerance: float) -> None:
    """Compare two fields, part by part.

    ONE and OTHER are results folders; the parts are their sections, in space the thirds of the height. Two fields
    agree where the 95 % upper bound of their difference, statistical noise removed, is within the tolerance.
    """
    from granpipe.analysis.compare import compare as compare_fields
    from granpipe.analysis.compare import difference_table, lacks_error_bar, thirds
    from granpipe.dem.sizes import size_classes
    from granpipe.field import Field
    from granpipe.pipeline.field_vessel import check_case
    from granpipe.pipeline.provenance import verified_gates
    from granpipe.system.manifest import verify

    verify(one, "field.npz", "case.yaml")
    verify(other, "field.npz")
    gates = {folder: verified_gates(folder) for folder in (one, other)}
    fields = Field.load(one / "field.npz"), Field.load(other / "field.npz")
    case = _read_result(one).case
    check_case(fields[0], case, one / "field.npz")
    levels = case.outline.levels if case.vessel is None else thirds(fields[0].grid)
    diameter = size_classes(case.material.size).sauter_diameter * case.dem.coarse_grain_factor
    click.echo(difference_table(compare_fields(*fields, levels, diameter), tolerance))
    unknown = [folder for folder, field in zip((one, other), fields, strict=True) if lacks_error_bar(field)]
    _tell(f"{folder}: its field has no error bar, so that its noise is in the difference" for folder in unknown)
    for folder, known in gates.items():
        _tell(f"{folder}: quality gate failed: {gate}" for gate in known if not gate.passed)


@main.command()
@click.argument("dumps", nargs=-1, required=True, type=_PATH)
@click.option("--cell", required=True, type=_Quantity("length", positive=True), help="Cell size, such as 15mm.")
@click.option("--plane", type=click.Choice(["rz", "xz", "xyz"]), default="rz", show_default=True,
              help="Rings about the z-axis, the plane x-z averaged over y, or 3-D space.")  # fmt: skip
@click.option("--x", nargs=2, type=_Quantity("length"), help="Range of x, such as --x 0 50cm; default: all particles.")
@click.option("--y", nargs=2, type=_Quantity("length"), help="Range of y; with --plane xz particles are cut there.")
@click.option("--z", nargs=2, type=_Quantity("length"), help="Range of z.")
@click.option("--time-step", required=True, type=_Quantity("time", positive=True),
              help="Time step of the simulation, to convert step numbers to times.")  # fmt: skip
@click.option(
    "--up", type=click.Choice(["x", "y", "z", "-x", "-y", "-z"]), help="Direction against gravity; default: z."
)
@click.option(
    "--axis", type=_Place(), metavar="X,Y", help="Place of the axis in the other two directions; default: 0,0."
)
@click.option(
    "--radius", type=_Quantity("length", positive=True), help="Radius of all particles, if the dumps lack it."
)
@click.option("--columns", help="Column names of binary dumps, comma-separated; default: those of granpipe's decks.")
@click.option("--start", type=_Quantity("time"), help="Time at which the average begins.")
@click.option("--stop", type=_Quantity("time"), help="Time at which the average ends.")
@click.option("--case", type=_PATH, help="Case that gives outline, method and flow rate.")
@click.option("--walls", type=_PATH, multiple=True,
              help="STL or OBJ file of the walls of a vessel, open at top and bottom; may be repeated.")  # fmt: skip
@click.option("--unit", default="m", show_default=True, help="Unit of the files of --walls, such as mm.")
@click.option("--out", required=True, type=_PATH, help="Folder for the field.")
def homogenize(
    dumps: tuple[Path, ...], cell: float, plane: Literal["rz", "xz", "xyz"], x: tuple[float, float] | None,
    y: tuple[float, float] | None, z: tuple[float, float] | None, time_step: float,
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None, axis: tuple[float, float] | None, radius: float | None,
    columns: str | None, start: float | None, stop: float | None, case: Path | None, walls: tuple[Path, ...], unit: str,
    out: Path,
) -> None:  # fmt: skip
    """Average DUMPS of your own LIGGGHTS run into a field.

    DUMPS are binary, text, gzipped or VTK dump files. With --case the field is made to conserve volume inside the
    case's outline, and with --plane xyz --walls inside these walls. Without them the field is the plain average on a
    grid around the particles; in the plane x-z it is made to conserve volume as well. Ranges are in the directions that
    --up and --axis make: z up, the axis at x = y = 0.
    """
    from granpipe.case import units
    from granpipe.pipeline.dump_files import write_homogenized
    from granpipe.pipeline.dump_window import Frame, Request
    from granpipe.pipeline.dumps import Walls, homogenize_files

    if not LEAST_TIME_STEP <= time_step <= MOST_TIME_STEP:
        message = f"{time_step:g} s is no time step of a particle simulation; it must be in [{LEAST_TIME_STEP:g}, "
        raise click.BadParameter(f"{message}{MOST_TIME_STEP:g}] s", param_hint="--time-step")
    outline_case = None if case is None else _read(case).case
    request = Request(
        dumps=dumps,
        frame=Frame(plane, cell, x, y, z, up, axis),
        time_step=time_step,
        columns=None if columns is None else tuple(columns.split(",")),
        start=-math.inf if start is None else start,
        stop=math.inf if stop is None else stop,
        radius=radius,
    )
    try:
        given = Walls(walls, units.length_unit(unit)) if walls else None
    except units.UnitError as error:
        raise click.BadParameter(str(error), param_hint="--unit") from None
    made = homogenize_files(request, outline_case, given)
    write_homogenized(made, outline_case, out)
    click.echo(f"field in {out}; sampled by {made.sampling}; method: {made.method}")
    for note in made.notes:
        click.echo(f"note: {note}")
    _end(made.failed)


@main.command()
@_CASE
@_SET
@_RESULTS
@click.option("--angle", type=_Quantity("angle", positive=True), required=True, metavar="ANGLE",
              help="Measured angle of repose, such as '34 deg'.")  # fmt: skip
@click.option("--error", type=_Quantity("angle"), default="1 deg", show_default=True, metavar="ANGLE",
              help="Standard error of the measured angle; one heap differs from the next by about 1 deg.")  # fmt: skip
@_CORES
def repose(
    case: Path, overrides: Mapping[str, str], results: Path, angle: float, error: float, cores: int | None
) -> None:
    """Find the friction that gives a measured angle of repose.

    Runs heaps of the particles of CASE with different friction, and tells which pairs of sliding and rolling friction
    give the angle. Finished heaps are not run again, and serve other angles too.
    """
    from granpipe.repose.run import calibrate_friction

    if not 0 <= math.degrees(error) <= MOST_ANGLE_ERROR:
        message = f"{math.degrees(error):.3g}° is not from 0 to {MOST_ANGLE_ERROR:g}°: a rougher angle tells nothing"
        raise click.BadParameter(message, param_hint="--error")
    with Console() as console:
        made = calibrate_friction(_read(case, overrides), angle, error, results, cores, console)
    click.echo(made.text, err=True)
    click.echo(f"figures and picture in {made.folder}", err=True)
    click.echo(made.yaml, nl=False)
    _end(made.found.failed)


@main.command()
@_CASE
@_SET
@_RESULTS
@click.option("--hours", type=click.FloatRange(min=0, min_open=True), default=2.0, show_default=True,
              help="Wall time for all points; the most expensive ones are dropped to fit.")  # fmt: skip
@click.option("--axis", "axes", multiple=True, metavar="AXIS[=VALUE,…]",
              help="Vary this setting only, with these values; may be repeated.")  # fmt: skip
@click.option("--point", "points", multiple=True, metavar="KEY=VALUE,…",
              help="A point with several changes of the run's settings; may be repeated. Without --axis only these are "
              "run.")  # fmt: skip
@click.option("--inputs", multiple=True, metavar="KEY=LOW..HIGH",
              help="Range of a property of the material or its contacts: uncertainty of inputs; may be repeated. "
              "Without --axis only this is run.")  # fmt: skip
@click.option("--reference", type=_PATH, metavar="RESULTS",
              help="Results of an earlier run of the same vessel and material, such as one with the material's own "
              "particles: all errors count from it instead of from the finest point.")  # fmt: skip
@click.option("--against", type=_PATH, help="Another case, whose run time is forecast at the measured speed.")
@_ON
@_CORES
@_CLUSTER
def study(
    case: Path, overrides: Mapping[str, str], results: Path, hours: float, axes: tuple[str, ...],
    points: tuple[str, ...], inputs: tuple[str, ...], reference: Path | None, against: Path | None, on: str,
    cores: int | None, cluster: Path,
) -> None:  # fmt: skip
    """Measure error against run time for variants of CASE.

    Runs cheaper and more expensive variants, compares their fields and recommends settings. Finished points are not
    repeated; points that are too short for a field go on, by half of their time at the most. On a cluster, run the
    command again when the jobs have ended: it then writes the report.
    """
    from granpipe.pipeline.run import plan_case
    from granpipe.study.axes import read_axes, read_point
    from granpipe.study.inputs import read_inputs
    from granpipe.study.points import make_study
    from granpipe.study.reference import read_reference
    from granpipe.study.run import run_study
    from granpipe.system.cores import usable_cores
    from granpipe.system.rates import known_rates

    if not hours > 0:  # nan
        raise click.BadParameter(f"{hours} must be above 0", param_hint="--hours")
    cores = cores or usable_cores()
    other = None if against is None else plan_case(_read(against), cores)
    asked = _read(case, overrides).case
    earlier = None if reference is None else read_reference(reference, asked)
    if earlier is not None:
        _tell(f"{reference}: quality gate failed: {gate}" for gate in earlier.failed)
    several, ranges = [read_point(words) for words in points], read_inputs(inputs, asked)
    made = make_study(asked, hours, cores, read_axes(axes), known_rates(), ranges, several)
    _tell(made.left_out)
    with Console() as console:
        found = run_study(made, results, other, cores, cluster if on == "slurm" else None, console, earlier)
    _tell(found.problems)
    click.echo(found.text)
    if not found.complete:
        sys.exit(GranpipeError.exit_status)


@main.group(cls=_SweepGroup)
def sweep() -> None:
    """Run many variants of a case, here or on a Slurm cluster.

    FILE is a sweep.yaml; status, cancel and table also take the folder of a sweep or of a study.
    """


@sweep.command("run")
@_FILE
@_RESULTS
@_ON
@_CORES
@_CLUSTER
@click.option("--dry-run", is_flag=True, help="Check every point, print the folder and the missing points, stop.")
@click.option("--write-only", is_flag=True, help="As --dry-run, but write the points to disk, for Snakemake.")
def sweep_run(
    file: Path, results: Path, on: str, cores: int | None, cluster: Path, dry_run: bool, write_only: bool
) -> None:
    """Run the points of FILE that are missing.

    Points that are done or in the queue are not run again.
    """
    from granpipe.sweep.file import read_sweep
    from granpipe.sweep.points import plan_points
    from granpipe.sweep.run import run_missing

    folder, points = plan_points(read_sweep(file), results)
    if write_only:
        with folder.started():
            pass
    if dry_run or write_only:
        click.echo("\n".join([str(folder.root), *(point.name for point in points)]))
        return
    with Console() as console:
        ended = run_missing(folder, points, cores, cluster if on == "slurm" else None, console)
    if ended:
        _write_table(folder)
    else:
        click.echo(f"follow it with: granpipe sweep status {folder.root}")


@sweep.command("status")
@_FILE
@_RESULTS
def sweep_status(file: Path, results: Path) -> None:
    """Show the state of every point of FILE."""
    from granpipe.study.folder import folder_of
    from granpipe.sweep.status import status_text, statuses

    click.echo(status_text(statuses(folder_of(file, results))))


@sweep.command("cancel")
@_FILE
@_RESULTS
def sweep_cancel(file: Path, results: Path) -> None:
    """Cancel the jobs of FILE, or stop its run here.

    What is finished is kept.
    """
    from granpipe.study.folder import folder_of
    from granpipe.sweep.jobs import cancel

    click.echo(cancel(folder_of(file, results)))


@sweep.command("table")
@_FILE
@_RESULTS
def sweep_table(file: Path, results: Path) -> None:
    """Write the table and chart of the points that are done."""
    from granpipe.study.folder import folder_of

    _write_table(folder_of(file, results))


@sweep.command("points", hidden=True)
@click.argument("folder", type=_PATH)
@click.argument("names", nargs=-1, required=True)
@click.option("--ranks", type=click.IntRange(1), default=1)
def sweep_points(folder: Path, names: tuple[str, ...], ranks: int) -> None:
    """Run points of a sweep one after the other: what its workers and jobs do."""
    from granpipe.sweep.folder import Folder
    from granpipe.sweep.points import run_points

    with Console() as console:
        run_points(Folder(folder), names, ranks, console)


def _write_table(folder: Folder) -> None:
    """Table, chart, and an exit status that tells whether all points are done, and well."""
    from granpipe.sweep.collect import write_table

    written = write_table(folder)
    _tell(written.failures)
    click.echo(written.text)
    _tell(f"granpipe: {problem}" for problem in written.problems)
    if not written.complete:
        sys.exit(GranpipeError.exit_status)
    if written.marked:
        sys.exit(QUALITY_FAILED)


def _read_result(folder: Path, overrides: Mapping[str, str] | None = None) -> CaseFile:
    """The case of a results folder."""
    from granpipe.errors import DataError

    if not (folder / "case.yaml").is_file():
        raise DataError(f"{folder} is not a results folder: it has no case.yaml")
    return _read(folder / "case.yaml", overrides)


def _read(path: Path, overrides: Mapping[str, str] | None = None) -> CaseFile:
    from granpipe.case.reader import read_case

    return read_case(path, dict(overrides or {}))


def _end(failed: Iterable[Gate]) -> None:
    """Say which quality gates failed, and end with a status that tells it."""
    names = [f"quality gate failed: {gate}" for gate in failed]
    _tell(names)
    if names:
        sys.exit(QUALITY_FAILED)


def _tell(lines: Iterable[str]) -> None:
    """Lines for standard error."""
    for line in lines:
        click.echo(line, err=True)


def _fail(message: str) -> NoReturn:
    click.echo(f"granpipe: {message}", err=True)
    sys.exit(GranpipeError.exit_status)


def _interrupt(*_: object) -> NoReturn:
    """SIGTERM ends a run as Ctrl-C does: every child is stopped, everything finished is kept."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
