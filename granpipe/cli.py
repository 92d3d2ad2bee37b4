"""The command line: the only place that prints and exits. Every command imports what it needs when it runs."""

from __future__ import annotations

import errno
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import click

from granpipe import __version__
from granpipe.console import Console
from granpipe.errors import GranpipeError

if TYPE_CHECKING:
    from granpipe.case.reader import CaseFile
    from granpipe.study.choice import Chosen
    from granpipe.sweep.folder import Folder

INTERRUPTED = 130
QUALITY_FAILED = 4

_CASE = click.argument("case", type=click.Path(path_type=Path))
_SET = click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the case.")
_RESULTS = click.option(
    "--results", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Results folder."
)
_SWEEP = click.argument("sweep", type=click.Path(path_type=Path))


class _Group(click.Group):
    """Turns the failures that granpipe explains into one message and an exit status."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except GranpipeError as error:
            click.echo(f"granpipe: {error}", err=True)
            sys.exit(error.exit_status)
        except KeyboardInterrupt:
            click.echo("granpipe: interrupted; run again to continue", err=True)
            sys.exit(INTERRUPTED)
        except BrokenPipeError:
            sys.exit(0)
        except OSError as error:
            remedy = (
                "make room and run again: it resumes"
                if error.errno == errno.ENOSPC
                else "choose another folder, or mend this one"
            )
            click.echo(f"granpipe: {error.filename or 'a file'}: {error.strerror}; {remedy}", err=True)
            sys.exit(GranpipeError.exit_status)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="granpipe")
def main() -> None:
    """Granular flow in axisymmetric vessels, as a velocity field for multiphysics programs.

    Exit status: 0 done, 2 the case is wrong, 3 a program or file failed, 4 done but a quality gate failed,
    130 interrupted.
    """
    signal.signal(signal.SIGTERM, _interrupt)


@main.command()
@_CASE
@_SET
@_RESULTS
@click.option("--total-error", metavar="ERROR", help="Take the cheapest setting that the case's study found so good.")
def run(case: Path, overrides: tuple[str, ...], results: Path, total_error: str | None) -> None:
    """Run CASE: from the outline to field, COMSOL files and pictures."""
    from granpipe.pipeline.run import run_case

    file, chosen = _read(case, overrides), None
    if total_error is not None:
        chosen = _chosen(file, results, total_error)
        file = chosen.file
        click.echo(chosen.expected)
    with Console() as console:
        outcome = run_case(file, results, console)
    if not outcome.made:
        click.echo(f"nothing to do: {outcome.folder} is up to date")
    else:
        click.echo(f"results in {outcome.folder}")
    if chosen is not None:
        click.echo(chosen.obtained(outcome.folder))
    for gate in outcome.failed:
        click.echo(f"quality gate failed: {gate}", err=True)
    if outcome.failed:
        sys.exit(QUALITY_FAILED)


@main.command()
@_CASE
@_SET
def plan(case: Path, overrides: tuple[str, ...]) -> None:
    """Show what a run of CASE would do, leave out and cost."""
    from granpipe.pipeline.run import plan_case
    from granpipe.planning.plan import model_plans
    from granpipe.planning.text import plan_text
    from granpipe.system.cores import usable_cores
    from granpipe.system.rates import known_rates

    file, cores = _read(case, overrides), usable_cores()
    click.echo(plan_text(plan_case(file, cores), model_plans(file.case, cores), known_rates()))


@main.command()
def calibrate() -> None:
    """Measure how fast this machine is, by a run of half a minute; plans then forecast their times by it."""
    from granpipe.pipeline.calibrate import calibrate as measure
    from granpipe.system.doctor import require
    from granpipe.system.rates import machine

    require("gmsh library")
    with Console() as console:
        rates = measure(console)
    for ranks, rate in rates.by_ranks.items():
        click.echo(f"{ranks} rank{'s' if ranks > 1 else ''}: {rate:.3g} particle-steps per second")
    click.echo(f"kept for {machine()}")


@main.command()
@_CASE
@_SET
def check(case: Path, overrides: tuple[str, ...]) -> None:
    """Check CASE without running it."""
    from granpipe.pipeline.run import plan_case
    from granpipe.system.cores import usable_cores

    made = plan_case(_read(case, overrides), usable_cores())
    for warning in (*made.warnings, *made.breaches):
        click.echo(f"note: {warning}")
    click.echo(f"{case}: good")


@main.command()
@click.argument("path", type=click.Path(path_type=Path), default=Path("case.yaml"))
def init(path: Path) -> None:
    """Write a commented starter case to PATH."""
    from granpipe.case.reader import starter_case

    try:
        with path.open("x") as file:
            file.write(starter_case())
    except FileExistsError:
        _fail(f"{path} exists already; give another name")
    except OSError as error:
        _fail(f"{path}: cannot be written ({error.strerror})")
    click.echo(f"wrote {path}; next: granpipe plan {path}")


@main.command()
def schema() -> None:
    """Print the JSON Schema of a case, for editors."""
    from granpipe.case.reader import schema_json

    click.echo(schema_json(), nl=False)


@main.command()
def doctor() -> None:
    """Say what is installed, in which version, and what a missing part would be needed for."""
    from granpipe.system.doctor import check as check_all

    findings = check_all()
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        state = finding.found or f"missing; needed for {finding.needed_for}; {finding.remedy}"
        click.echo(f"{finding.name:<{width}}  {state}")
    if any(finding.found is None for finding in findings):
        sys.exit(3)


@main.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--flow", required=True, help="Flow rate, such as 2[m^3/h] or 1 t/h.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the new files.")
def scale(result: Path, flow: str, out: Path) -> None:
    """Write the export files of RESULT, a results folder, for another flow rate, without solving anything."""
    from granpipe.pipeline.scale import scale_results

    file = _read_result(result, (f"flow_rate={flow}",))
    if warning := scale_results(result, file.case, out):
        click.echo(f"warning: {warning}", err=True)
    click.echo(f"scaled results in {out}")


@main.command()
@click.argument("one", type=click.Path(path_type=Path))
@click.argument("other", type=click.Path(path_type=Path))
@click.option("--tolerance", default="5 %", show_default=True, help="Difference up to which two fields agree.")
def compare(one: Path, other: Path, tolerance: str) -> None:
    """Compare the fields of two results folders, ONE and OTHER, section by section.

    They agree only where the 95 % upper bound of the difference without noise lies within the tolerance.
    """
    from granpipe.analysis.compare import compare as compare_fields
    from granpipe.case.units import NUMBER, in_si
    from granpipe.dem.sizes import size_classes
    from granpipe.field import Field

    limit = _quantity(in_si, tolerance, NUMBER, "--tolerance")
    fields = Field.load(one / "field.npz"), Field.load(other / "field.npz")
    case = _read_result(one).case
    diameter = size_classes(case.material.size).sauter_diameter * case.dem.coarse_grain_factor
    found = compare_fields(*fields, case.outline.levels, diameter)
    click.echo(f"{'section':<12}{'difference':>12}{'noise':>10}{'noise-free':>12}{'95 % below':>12}")
    for d in found:
        numbers = f"{d.observed:>12.2%}{d.noise:>10.2%}{d.noise_free:>12.2%}{d.upper:>12.2%}"
        click.echo(f"{d.name:<12}{numbers}  {d.verdict(limit)}")


@main.command()
@_RESULTS
def clean(results: Path) -> None:
    """Delete the store of intermediate stages; results folders stay."""
    from granpipe.system.store import Store

    store = results / ".store"
    if not store.is_dir():
        click.echo(f"nothing to do: there is no {store}")
        return
    freed, kept = Store(store).clear()
    click.echo(f"freed {freed / 1e6:.1f} MB; the next run of a case starts anew")
    for why in kept:
        click.echo(f"kept {why}", err=True)
    if kept:
        sys.exit(GranpipeError.exit_status)


@main.command()
@click.argument("dumps", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--cell", required=True, help="Edge of a cell, such as 0.015 or 15mm.")
@click.option(
    "--plane",
    type=click.Choice(["rz", "xz", "xyz"]),
    default="rz",
    show_default=True,
    help="Rings about the z-axis, the plane x-z averaged over y, or space.",
)
@click.option("--x", nargs=2, help="Range of x, such as --x 0 50cm; by default that of the particles in the box.")
@click.option("--y", nargs=2, help="Range of y; with --plane xz particles are cut at its ends.")
@click.option("--z", nargs=2, help="Range of z.")
@click.option("--time-step", required=True, help="Time step of the run [s], to turn steps into times.")
@click.option("--columns", help="Column names of binary dumps, comma-separated; default: those of granpipe's decks.")
@click.option("--start", help="Time at which averaging begins [s].")
@click.option("--stop", help="Time at which averaging ends [s].")
@click.option("--case", type=click.Path(path_type=Path), help="Case that gives outline, method and flow rate.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the field.")
def homogenize(
    dumps: tuple[Path, ...],
    cell: str,
    plane: Literal["rz", "xz", "xyz"],
    x: tuple[str, str] | None,
    y: tuple[str, str] | None,
    z: tuple[str, str] | None,
    time_step: str,
    columns: str | None,
    start: str | None,
    stop: str | None,
    case: Path | None,
    out: Path,
) -> None:
    """Average LIGGGHTS dumps (binary, text or .gz) into a field.

    Without a case the field is the plain average on a grid round the particles, in the plane x-z made to conserve; with
    one it is made to conserve on the case's outline.
    """
    from granpipe.case.units import LENGTH, TIME, in_si
    from granpipe.pipeline.dump_grid import Frame
    from granpipe.pipeline.dumps import Request, homogenize_files, write_field

    def seconds(text: str | None, default: float, option: str) -> float:
        return default if text is None else _quantity(in_si, text, TIME, option)

    def ends(texts: tuple[str, str] | None, option: str) -> tuple[float, float] | None:
        if texts is None:
            return None
        low, high = (_quantity(in_si, text, LENGTH, option) for text in texts)
        return low, high

    outline_case = None if case is None else _read(case, ()).case
    request = Request(
        dumps=dumps,
        frame=Frame(plane, _quantity(in_si, cell, LENGTH, "--cell"), ends(x, "--x"), ends(y, "--y"), ends(z, "--z")),
        time_step=seconds(time_step, 0.0, "--time-step"),
        start=seconds(start, float("-inf"), "--start"),
        stop=seconds(stop, float("inf"), "--stop"),
        **({} if columns is None else {"columns": tuple(columns.split(","))}),
    )
    made = homogenize_files(request, outline_case)
    write_field(made.field, outline_case, out)
    click.echo(f"field in {out}; sampled by {made.sampling}; method: {made.method}")


@main.command()
@_SWEEP
@_RESULTS
@click.option("--on", type=click.Choice(["local", "slurm"]), default="local", show_default=True, help="Where to run.")
@click.option("--cores", type=click.IntRange(1), help="Cores to use here; all that this process may use by default.")
@click.option("--cluster", type=click.Path(path_type=Path), default=Path("cluster.yaml"), show_default=True,
              help="What jobs ask the cluster for.")  # fmt: skip
@click.option(
    "--dry-run", is_flag=True, help="Check every point; print the folder and the missing points; run nothing."
)
@click.option("--write-only", is_flag=True, help="As --dry-run, but write down the points for Snakemake to run them.")
def sweep(
    sweep: Path, results: Path, on: str, cores: int | None, cluster: Path, dry_run: bool, write_only: bool
) -> None:
    """Run every point of SWEEP, a sweep.yaml: here, or as array jobs on a Slurm cluster.

    What is done is not repeated, and what is in the queue is not submitted again.
    """
    from granpipe.sweep.file import read_profile, read_sweep
    from granpipe.sweep.points import plan_points

    profile = read_profile(cluster) if on == "slurm" else None
    folder, points = plan_points(read_sweep(sweep), results)
    if write_only:
        with folder.started():
            pass
    if dry_run or write_only:
        click.echo("\n".join([str(folder.root), *(point.name for point in points)]))
        return
    if profile is not None:
        from granpipe.sweep.jobs import submit

        with Console() as console:
            submit(folder, points, profile, console)
        click.echo(f"follow it with: granpipe status {folder.root}")
        return
    from granpipe.sweep.local import run_here
    from granpipe.system.cores import usable_cores

    with Console() as console:
        run_here(folder, points, cores or usable_cores(), console)
    _reduce(folder)


@main.command()
@_CASE
@_SET
@_RESULTS
@click.option("--hours", type=click.FloatRange(min=0, min_open=True), default=2.0, show_default=True,
              help="Wall time that the points may take by their plans; the dearest are dropped.")  # fmt: skip
@click.option("--axis", "axes", multiple=True, metavar="AXIS[=VALUE,…]",
              help="Go along this axis only, with these values; may be given several times.")  # fmt: skip
@click.option("--against", type=click.Path(path_type=Path), help="Case whose time is forecast at the measured rate.")
@click.option("--on", type=click.Choice(["local", "slurm"]), default="local", show_default=True, help="Where to run.")
@click.option("--cores", type=click.IntRange(1), help="Cores to use here; all that this process may use by default.")
@click.option("--cluster", type=click.Path(path_type=Path), default=Path("cluster.yaml"), show_default=True,
              help="What jobs ask the cluster for.")  # fmt: skip
def study(
    case: Path, overrides: tuple[str, ...], results: Path, hours: float, axes: tuple[str, ...], against: Path | None,
    on: str, cores: int | None, cluster: Path,
) -> None:  # fmt: skip
    """Run cheaper and dearer variants of CASE, and tell the error of each against the time that it takes.

    What is done is not repeated. On a cluster, run the command again when the jobs have ended: it makes the report.
    """
    from granpipe.pipeline.run import plan_case
    from granpipe.study.ladder import read_axes
    from granpipe.study.points import make_study
    from granpipe.study.run import prepare_study, report_study
    from granpipe.sweep.status import standings
    from granpipe.system.cores import usable_cores
    from granpipe.system.rates import known_rates

    if not hours > 0:  # no number
        raise click.BadParameter(f"{hours} must be above 0", param_hint="--hours")
    cores = cores or usable_cores()
    other = None if against is None else plan_case(_read(against, ()), cores)
    made = make_study(_read(case, overrides).case, hours, cores, read_axes(axes), known_rates())
    for rung in made.dropped:
        seconds = made.forecast[rung.variant.name]
        click.echo(f"left out: {rung.variant.name}, {seconds / 3600:.2g} h; give more --hours to have it", err=True)
    prepared = prepare_study(made, results)
    with Console() as console:
        if prepared.points and on == "slurm":
            from granpipe.sweep.file import read_profile
            from granpipe.sweep.jobs import submit

            submit(prepared.folder, prepared.points, read_profile(cluster), console)
            click.echo(f"follow it with: granpipe status {prepared.folder.root}; then run this command again")
            return
        from granpipe.sweep.local import run_here

        run_here(prepared.folder, prepared.points, cores, console)
        files, missing = report_study(prepared.folder, other, console)
    if marked := [one.name for one in standings(prepared.folder) if one.word == "done" and one.text]:
        click.echo(f"a quality gate failed in {', '.join(marked)}: granpipe status {prepared.folder.root}", err=True)
    for one in missing:
        click.echo(f"{one.name}: {one.text or one.word}", err=True)
    for file in files:
        click.echo(f"wrote {file}")
    if missing:
        sys.exit(3)


@main.command(hidden=True)
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("names", nargs=-1, required=True)
@click.option("--ranks", type=click.IntRange(1), default=1)
def points(folder: Path, names: tuple[str, ...], ranks: int) -> None:
    """Run points of a sweep one after the other: what its workers and jobs do."""
    from granpipe.sweep.folder import Folder
    from granpipe.sweep.points import run_points

    with Console() as console:
        run_points(Folder(folder), names, ranks, console)


@main.command()
@_SWEEP
@_RESULTS
def status(sweep: Path, results: Path) -> None:
    """Show how every point of SWEEP stands (a sweep.yaml, or the folder of a sweep or study)."""
    from granpipe.sweep.status import standings, summary

    found = standings(_sweep_folder(sweep, results))
    width = max(len(one.name) for one in found)
    for one in found:
        click.echo(f"{one.name:<{width}}  {one.word:<7}  {one.text.splitlines()[0] if one.text else ''}".rstrip())
    click.echo(summary(found))


@main.command()
@_SWEEP
@_RESULTS
def cancel(sweep: Path, results: Path) -> None:
    """Cancel the jobs of SWEEP, or end the process that runs it here; what is finished is kept.

    SWEEP is a sweep.yaml, or the folder of a sweep or study.
    """
    from granpipe.sweep.jobs import cancel as cancel_sweep

    click.echo(cancel_sweep(_sweep_folder(sweep, results)))


@main.command()
@_SWEEP
@_RESULTS
def reduce(sweep: Path, results: Path) -> None:
    """Write table and chart of SWEEP from the points that are done."""
    _reduce(_sweep_folder(sweep, results))


def _sweep_folder(path: Path, results: Path) -> Folder:
    """The folder of a sweep or study, by itself or by a sweep.yaml."""
    from granpipe.sweep.file import is_case
    from granpipe.sweep.folder import find_folder

    if path.is_file() and is_case(path):
        from granpipe.errors import CaseError
        from granpipe.study.points import study_name

        folder = results / study_name(_read(path, ()).case)
        found = f"give the folder of its study, {folder}" if folder.is_dir() else f"it has no study in {results}"
        raise CaseError(f"is a case, not a sweep; {found}", place=str(path))
    return find_folder(path, results)


def _reduce(folder: Folder) -> None:
    """Table, chart, and an exit status that tells whether all points are done, and well."""
    from granpipe.sweep.reduce import reduce as reduce_sweep
    from granpipe.sweep.status import summary

    reduced = reduce_sweep(folder)
    found = reduced.standings
    for one in found:
        if one.word == "failed":
            click.echo(f"{one.name}: {one.text}", err=True)
    click.echo(summary(found))
    for file in reduced.files:
        click.echo(f"wrote {file}")
    for problem in reduced.problems:
        click.echo(f"granpipe: {problem}", err=True)
    if reduced.problems or any(one.word != "done" for one in found):
        sys.exit(3)
    if any(one.text for one in found):
        sys.exit(QUALITY_FAILED)


def _chosen(file: CaseFile, results: Path, total_error: str) -> Chosen:
    from granpipe.case.units import NUMBER, in_si
    from granpipe.study.choice import choose

    return choose(file, results, _quantity(in_si, total_error, NUMBER, "--total-error"))


def _quantity(read: Any, text: str, dimension: Any, option: str) -> float:
    from granpipe.case.units import UnitError
    from granpipe.case.yamlfile import plain_value

    try:
        value = float(read(plain_value(text), dimension))
    except UnitError as error:
        raise click.BadParameter(str(error), param_hint=option) from None
    if option in ("--cell", "--time-step", "--tolerance", "--total-error") and not value > 0:
        raise click.BadParameter(f"{text} must be above 0", param_hint=option)
    return value


def _read_result(folder: Path, overrides: tuple[str, ...] = ()) -> CaseFile:
    """The case of a results folder."""
    from granpipe.errors import DataError

    if not (folder / "case.yaml").is_file():
        raise DataError(f"{folder} is no results folder: it has no case.yaml")
    return _read(folder / "case.yaml", overrides)


def _read(path: Path, overrides: tuple[str, ...]) -> CaseFile:
    from granpipe.case.reader import read_case

    pairs = [text.partition("=") for text in overrides]
    for key, sign, _ in pairs:
        if not sign or not key:
            _fail(f"--set {key}: write it as --set key=value, such as --set dem.seed=2", status=2)
    return read_case(path, {key: value for key, _, value in pairs})


def _fail(message: str, status: int = 3) -> NoReturn:
    click.echo(f"granpipe: {message}", err=True)
    sys.exit(status)


def _interrupt(*_: object) -> NoReturn:
    """SIGTERM ends a run as Ctrl-C does: every child is stopped, everything finished is kept."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
