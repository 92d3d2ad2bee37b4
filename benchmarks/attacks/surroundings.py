"""Attacks on what surrounds a command: environment, limits, disks, users, programs, streams, signals, other processes.

Each is a shell script in a folder of its own, in which ``$G`` is granpipe, ``silo.yaml`` a fluid and ``bed.yaml`` a
particle run with a stand-in for LIGGGHTS (tests/fakes). What must come out at its end is known: the field of an
undisturbed run, to rounding. Some need root: to mount a small disk, or to give its rights away.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from fakes.liggghts import install

from attacks.attack import Attack, Check, Ran, Right, forked, refused, right, unique
from attacks.cases import BED, varied
from attacks.results import CASE, whole
from granpipe.cli import QUALITY_FAILED
from granpipe.field import Field
from granpipe.system.manifest import changed_files

ROOT = Path(__file__).parents[2]
POOR = "setpriv --bounding-set=-all --inh-caps=-all"
"""Takes the rights of root from a command: files are then closed to it as their bits say."""

INSIDE = "unshare -m --propagation private bash -ec"
"""Mounts of a script in it are seen by nobody else."""

BED_CASE = varied(
    BED,
    {"flow_rate": "1 kg/s", "dem.reservoir_height": "8 cm", "contact.youngs_modulus": 2e6, "figures": [], "export": []},
)
"""The beginning of a run, so that gates fail: nothing is wrong with that."""


def attacks() -> list[Attack]:
    """Every attack on surroundings."""
    kinds: tuple[Callable[[], Iterator[Attack]], ...] = (
        environment,
        limits,
        disks,
        places,
        programs,
        streams,
        signals,
        together,
    )
    return unique([attack for kind in kinds for attack in kind()])


@cache
def programs_folder() -> Path:
    """Where the stand-in is."""
    folder = Path(tempfile.mkdtemp(prefix="attacks-bin-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return install(folder)


def shell(script: str, **environment: str) -> Callable[[Path], Ran]:
    """An act: a script, with granpipe's own environment and these changes of it."""

    def act(folder: Path) -> Ran:
        (folder / "silo.yaml").write_text(CASE)
        (folder / "bed.yaml").write_text(BED_CASE)
        known = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}
        known["PATH"] = f"{programs_folder()}:{known['PATH']}"
        own = {"G": f"{sys.executable} -m granpipe", "PYTHONPATH": str(ROOT), "STAND_IN": str(programs_folder())}
        command = ["/bin/bash", "-c", script]
        return forked(lambda: os.execve(command[0], command, known | own | environment), folder)

    return act


def done(name: str = "silo", place: str = "") -> Check:
    """The field is that of an undisturbed run, every file is whole, and nothing half-done is left beside it."""

    def check(folder: Path, output: str) -> str:
        results = folder / (place or f"results/{name}")
        left = [str(path.relative_to(folder)) for path in results.parent.rglob("*.part")]
        if left:
            return f"left behind: {left}"
        if name == "silo":
            return whole(place=str(results))(folder, output)
        if changed_files(results):
            return "the results are not whole"
        one, other = Field.load(results / "field.npz"), Field.load(unbroken() / "results/bed/field.npz")
        near = np.allclose(one.flux_z, other.flux_z, rtol=1e-9, atol=1e-15)
        return "" if near else "another field"

    return check


@cache
def unbroken() -> Path:
    """A folder with the results of an undisturbed run of the bed."""
    folder = Path(tempfile.mkdtemp(prefix="attacks-bed-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    ran = shell("$G run bed.yaml")(folder)
    assert ran.status in (0, 4), ran.output
    return folder


PRODUCING = "until test -e results/.store/produce-*/segment-00002; do sleep 0.1; done; "
"""Waits for the second segment of a particle run."""

BEGUN = "until grep -q numpy /proc/$p/maps || ! test -e /proc/$p; do sleep 0.02; done 2> /dev/null; "
"""Waits until granpipe imports what it needs: before that, an interrupt is Python's own affair."""

NONE_LEFT = 'sleep 0.3; if ls -l /proc/[0-9]*/cwd 2> /dev/null | grep "$PWD/results"; then exit 99; fi; '
"""Fails where a process still works in the results."""

SILO = right(done())
"""The fluid is right."""

BEDDED = right(done("bed"), "results in")
"""The particle run is right."""


def tried(
    kind: str, name: str, what: Right, script: str = "$G run silo.yaml", pinned: bool = False, **environment: str
) -> Attack:
    """An attack by a script and an environment; that the bed's field is marked is as it should be."""
    act = shell(script, **environment)

    def marked_too(folder: Path) -> Ran:
        ran = act(folder)
        return replace(ran, status=0) if ran.status == QUALITY_FAILED and "bed.yaml" in script else ran

    return Attack(kind, name, marked_too, what, pinned)


def with_figure(script: str) -> str:
    """The same with pictures."""
    return script.replace("silo.yaml", "silo.yaml --set figures=[rz]")


def environment() -> Iterator[Attack]:
    """Variables and styles."""

    def of(name: str, what: Right = SILO, script: str = "$G run silo.yaml", **variables: str) -> Attack:
        return tried("environment", name, what, script, **variables)

    drawn = with_figure("$G run silo.yaml")
    # the drawing of pictures does not change the field
    yield of("MPLBACKEND of Jupyter", SILO, drawn, MPLBACKEND="module://matplotlib_inline.backend_inline")
    yield of("MPLBACKEND of nothing", SILO, drawn, MPLBACKEND="nonsense")
    yield of("text.usetex", SILO, f"echo 'text.usetex: True' > matplotlibrc; {drawn}")
    yield of("a damaged matplotlibrc", SILO, f"printf 'no style\\n' > matplotlibrc; {drawn}")
    yield of(
        "a matplotlibrc in Latin-1",
        refused("matplotlibrc.*UTF-8"),
        f"printf 'font.size: \\xff' > matplotlibrc; {drawn}",
    )
    yield of("MPLCONFIGDIR cannot be made", SILO, drawn, MPLCONFIGDIR="/proc/none")
    yield of("no HOME", SILO, f"unset HOME; {drawn}")
    yield of("HOME is a file", SILO, f"HOME=$PWD/silo.yaml; {drawn}")
    yield of("HOME is nowhere", SILO, drawn, HOME="/no/where")
    yield of("no environment at all", SILO, "env -i $G run silo.yaml".replace("$G", f"PYTHONPATH={ROOT} $G"))
    planned = "$G plan silo.yaml && $G run silo.yaml"
    yield of("ASCII", SILO, planned, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    yield of("streams in ASCII", SILO, planned, PYTHONIOENCODING="ascii:strict")
    yield of("a locale that is not there", SILO, LC_ALL="tr_TR.ISO-8859-9")
    yield of("python -OO", SILO, PYTHONOPTIMIZE="2")
    yield of("warnings are errors", SILO, drawn, PYTHONWARNINGS="error")
    yield of("developer's Python", SILO, PYTHONDEVMODE="1")
    shadow = (
        'echo \'open("ran", "w")\' > gmsh.py; cp gmsh.py numpy.py; python=${G%% *}; '
        "${python%/*}/granpipe doctor | grep 'gmsh library  *[0-9]' && ! test -e ran && rm *.py && $G run silo.yaml"
    )
    yield of("a gmsh.py of the user's", SILO, shadow)
    for cores in ("nonsense", "0", "-1"):
        yield of(f"GRANPIPE_CORES={cores}", SILO, "$G run silo.yaml", GRANPIPE_CORES=cores)
    yield of("GRANPIPE_CORES=1000000000000", BEDDED, "$G run bed.yaml", GRANPIPE_CORES="1000000000000")
    for threads in ("nonsense", "0", "100000"):
        yield of(f"OMP_NUM_THREADS={threads}", OMP_NUM_THREADS=threads, OPENBLAS_NUM_THREADS=threads)
    yield of("NUMBA_CACHE_DIR cannot be made", BEDDED, "$G run bed.yaml", NUMBA_CACHE_DIR="/proc/none")
    yield of("TMPDIR is nowhere", TMPDIR="/no/where")
    yield of("TMPDIR is a file", SILO, "TMPDIR=$PWD/silo.yaml $G run silo.yaml")
    yield of("TMPDIR is nowhere, particles", BEDDED, "$G run bed.yaml", TMPDIR="/no/where")
    huge = 'x="$(head -c 100000 /dev/zero | tr "\\0" x)"; for i in {1..15}; do export V$i="$x"; done; $G run silo.yaml'
    yield of("1.5 MB of variables", SILO, huge)
    yield of("one column", COLUMNS="1", LINES="1")
    yield of("COLUMNS=nonsense", COLUMNS="nonsense", TERM="nonsense")
    yield of("a display that is not there", BEDDED, "$G run bed.yaml --set figures=[vessel]", DISPLAY=":99")
    yield of("no such library to be preloaded", SILO, LD_PRELOAD="/no/such.so")
    backwards = "import time, itertools; n = itertools.count(); time.time = lambda: 2e9 - 3600 * next(n)"
    script = f"mkdir site; echo '{backwards}' > site/sitecustomize.py; PYTHONPATH=$PYTHONPATH:site $G run bed.yaml"
    yield of("the clock goes backwards", BEDDED, script)
    for year in ("1970-01-02", "2100-01-01"):
        again = f"$G run silo.yaml && find results -exec touch -d {year} {{}} + && $G run silo.yaml"
        yield of(f"results of {year}", right(done(), "nothing to do"), again)


def limits() -> Iterator[Attack]:
    """Limits of the process (ulimit)."""

    def of(name: str, what: Right, script: str, pinned: bool = False) -> Attack:
        return tried("limits", name, what, script, pinned)

    def left(name: str = "silo") -> Right:
        """Refused or right; run again without the limit it is right."""
        return right(done(name))

    yield of("400 MB of addresses", refused("limit on address space"), "ulimit -v 400000; $G run silo.yaml")
    for size in ("700000", "900000", "1200000"):
        what = right(done())
        yield of(f"{size} kB of addresses, then all", what, f"(ulimit -v {size}; $G run silo.yaml); $G run silo.yaml")
    for number in (8, 16, 32, 64):
        script = f"(ulimit -n {number}; $G run silo.yaml); $G run silo.yaml"
        yield of(f"{number} open files, then more", left(), script)
    yield of("20 open files, particles", left("bed"), "(ulimit -n 20; $G run bed.yaml); $G run bed.yaml")
    for blocks in (0, 1, 50):
        script = f"(ulimit -f {blocks}; $G run silo.yaml); $G run silo.yaml"
        yield of(f"files of {blocks} kB, then larger", left(), script)
    yield of("files of 50 kB, particles", left("bed"), script.replace("silo", "bed"))
    yield of("1 s of processor", left(), "(ulimit -t 1; $G run silo.yaml); $G run silo.yaml")
    yield of("a small stack", SILO, "ulimit -s 512; $G run silo.yaml")


def disks() -> Iterator[Attack]:
    """Disks that are full, small, read-only, or go away."""
    if os.geteuid():
        return

    def on(name: str, options: str, case: str = "silo", place: str = "results") -> Attack:
        """A small disk on which the command fails in one message; with room it goes on."""
        inside = (
            f"mkdir {place}; mount -t tmpfs -o {options} tmpfs {place}; "
            f"if $G run {case}.yaml; then echo it fitted; else s=$?; test $s = 3 -o $s = 4 || exit 99; fi; "
            f"mount -o remount,size=900m,nr_inodes=100000 {place}; "
            f"$G run {case}.yaml || test $? = 4; cp -r results found"
        )
        script = f"TMPDIR=${{TMPDIR:-/tmp}} {INSIDE} '{inside}'"
        return tried("disks", name, right(done(case, f"found/{case}")), script)

    for size in ("4k", "64k", "300k", "1m"):
        yield on(f"results on {size}", f"size={size}")
    yield on("particles on 1 MB", "size=1m", "bed")
    yield on("particles on 201 MB", "size=211000k", "bed")
    for number in (2, 5, 12):
        yield on(f"{number} files", f"size=900m,nr_inodes={number}")
    full = "mkdir tmp; mount -t tmpfs -o size=4k tmpfs tmp; head -c 4096 /dev/zero > tmp/full || true; "
    full += "export TMPDIR=$PWD/tmp; "
    yield tried("disks", "TMPDIR is full", SILO, f"{INSIDE} '{full} $G run silo.yaml'")
    yield tried("disks", "TMPDIR is full, particles", BEDDED, f"{INSIDE} '{full} $G run bed.yaml'")
    readonly = "mkdir results; mount -t tmpfs -o ro tmpfs results; $G run silo.yaml"
    yield tried("disks", "results are read-only", refused("[Rr]ead-only|not writable"), f"{INSIDE} '{readonly}'")
    home = f"mount --bind {ROOT} {ROOT}; mount -o remount,ro,bind {ROOT}; mount -t tmpfs -o ro tmpfs $HOME/.cache; "
    make = "mkdir -p $HOME/.cache; "
    for case, what in (("silo", SILO), ("bed", BEDDED)):
        script = f"{make}{INSIDE} '{home} $G run {case}.yaml'"
        yield tried("disks", f"installation and caches are read-only, {case}", what, script)


def places() -> Iterator[Attack]:
    """Folders, their rights and names."""

    def of(name: str, what: Right, script: str, pinned: bool = False) -> Attack:
        return tried("places", name, what, script, pinned)

    yield of("the folder is deleted before", refused("[Nn]o such file|folder|directory"),
             "here=$PWD; mkdir d; cd d; rmdir ../d; $G run $here/silo.yaml")  # fmt: skip
    yield of("the folder is deleted, results elsewhere", SILO,
             "here=$PWD; mkdir d; cd d; rmdir ../d; $G run $here/silo.yaml --results $here/results")  # fmt: skip
    begun = f"FAKE_PAUSE=0.3 $G run bed.yaml & {PRODUCING}"
    failed = "wait $!; test $? = 3 || exit 99; "
    yield of("results are deleted meanwhile", BEDDED, f"{begun} rm -rf results; {failed} $G run bed.yaml")
    moved = f"{begun} mv results r; {failed} mv results r2; mv r results; $G run bed.yaml"
    yield of("results are moved away meanwhile", BEDDED, moved)
    for name, place in {
        "spaces and quotes": "a \"b\" 'c'",
        "a line break": "a\nb",
        "a command": "$(id)",
        "a dash": "./-rf",
        "a dollar": "${x}",
        "letters of others": "Ünïcødé 結果",
        "braces": "{{x}} %s {0}",
    }.items():
        quoted = "'" + place.replace("'", "'\\''") + "'"
        for case in ("silo", *(("bed",) if name in ("spaces and quotes", "a line break", "letters of others") else ())):
            script = f"$G run {case}.yaml --results {quoted}"
            yield of(f"results in {name}, {case}", right(done(case, f"{place}/{case}")), script)
    what = refused("not UTF-8 text; rename it")
    for case in ("silo", "bed"):
        yield of(f"results in no UTF-8, {case}", what, f"$G run {case}.yaml --results $'\\xff\\xfe'")
    script = "mv silo.yaml $'\\xff.yaml'; $G plan $'\\xff.yaml' && $G run $'\\xff.yaml'"
    yield of("a case file in no UTF-8", what, script)
    deep = "/".join(["d" * 200] * 18)
    yield of("a path of 3 600 characters", right(done("bed", f"{deep}/bed")), f"$G run bed.yaml --results {deep}")
    if os.geteuid():
        return
    denied = refused("not writable|[Pp]ermission|not readable")
    yield of("results may not be written", denied, f"mkdir results; chmod 500 results; {POOR} $G run silo.yaml")
    script = f"mkdir -p results/.store; chmod 500 results/.store; {POOR} $G run bed.yaml"
    yield of("the store may not be written", denied, script)
    yield of("the case may not be read", denied, f"chmod 0 silo.yaml; {POOR} $G run silo.yaml")
    yield of("HOME may not be read", SILO, f"mkdir h; chmod 0 h; HOME=$PWD/h {POOR} $G run silo.yaml")
    yield of("HOME may not be written, particles", BEDDED, f"mkdir h; chmod 500 h; HOME=$PWD/h {POOR} $G run bed.yaml")
    yield of(
        "calibrate where nothing can be kept",
        refused("not writable"),
        f"mkdir h; chmod 500 h; HOME=$PWD/h {POOR} $G calibrate",
    )
    yield of("TMPDIR may not be written", SILO, f"mkdir t; chmod 500 t; TMPDIR=$PWD/t {POOR} $G run silo.yaml")
    yield of("umask 777", denied, f"umask 777; {POOR} $G run silo.yaml")
    yield of("umask 777, particles", denied, f"umask 777; {POOR} $G run bed.yaml")
    yield of("umask 077", SILO, f"umask 077; {POOR} $G run silo.yaml")
    taken = f"$G run silo.yaml && chmod -R a-w results && {POOR} $G run silo.yaml --set flow_rate='2 m^3/h'; s=$?; "
    script = f"{taken} chmod -R u+w results; test $s = 3 || exit 99; $G run silo.yaml"
    yield of("results were made read-only", SILO, script)


def programs() -> Iterator[Attack]:
    """Programs that are missing, broken or others."""

    def of(name: str, what: Right, script: str, pinned: bool = False) -> Attack:
        return tried("programs", name, what, script, pinned)

    run = "PATH=$PWD/bin:$PATH $G run bed.yaml"

    def other(text: str) -> str:
        """Another program with the name of LIGGGHTS."""
        return f"mkdir bin; printf %b {_quoted(text)} > bin/liggghts; chmod +x bin/liggghts; {run}"

    yield of("no PATH", refused("liggghts is not installed"), "PATH=/no/where $G run bed.yaml")
    yield of("PATH is unset", refused("liggghts"), "unset PATH; $G run bed.yaml")
    yield of("no PATH, a fluid", SILO, "PATH= $G run silo.yaml")
    yield of("no mpirun", refused("openmpi-bin"), "PATH=$STAND_IN $G run bed.yaml --set dem.ranks=2")
    for name, text in {
        "true": "#!/bin/sh\nexit 0",
        "false": "#!/bin/sh\nexit 1",
        "cat": "#!/bin/sh\nexec cat",
        "not a program": "\x7fELF nonsense",
        "without an interpreter": "#!/no/where\n",
        "LAMMPS": "#!/bin/sh\necho 'LAMMPS (29 Aug 2024)'\n",
        "one that crashes": "#!/bin/sh\nkill -SEGV $$\n",
    }.items():
        what = refused("liggghts.*does not start|LIGGGHTS")
        yield of(f"liggghts is {name}", what, other(text))
    yield of("liggghts may not be run", BEDDED, f"mkdir bin; echo x > bin/liggghts; {run}")
    yield of("liggghts is a folder", BEDDED, f"mkdir -p bin/liggghts; {run}")
    endless = "#!/bin/sh\nwhile :; do echo LAMMPS LAMMPS LAMMPS; done"
    yield of("liggghts prints without end", refused("LIGGGHTS|liggghts"), f"ulimit -v 4000000; {other(endless)}")
    yield of("liggghts never answers", refused("did not answer"), other("#!/bin/sh\nexec sleep 900"))
    binary = "#!/bin/sh\nhead -c 3000 /dev/urandom; echo; echo LIGGGHTS 3.8; head -c 100 /dev/urandom"
    yield of("liggghts says its name in noise", refused(), other(binary))
    broken = "mkdir site; echo 'raise OSError(\"libGLU.so.1: cannot open shared object file\")' > site/gmsh.py; "
    broken += "PYTHONPATH=site:$PYTHONPATH $G run"
    yield of("gmsh does not load", refused("libglu1-mesa|granpipe doctor"), f"{broken} bed.yaml")
    yield of("gmsh does not load, a fluid", refused("libGLU|granpipe doctor"), f"{broken} silo.yaml")
    deaf = (
        "mkdir bin; cat > bin/liggghts <<'END'\n#!/bin/bash\ntrap '' INT TERM HUP\n"
        'exec $STAND_IN/liggghts "$@"\nEND\n'
        "chmod +x bin/liggghts; PATH=$PWD/bin:$PATH; FAKE_PAUSE=0.2 $G run bed.yaml & "
        f"{PRODUCING} kill -TERM $!; wait $!; "
        f"test $? = 130 || exit 99; {NONE_LEFT} $G run bed.yaml"
    )
    yield of("liggghts is deaf to signals", BEDDED, deaf)


def streams() -> Iterator[Attack]:
    """Streams that are closed, full or read by nobody, and terminals."""

    def of(name: str, what: Right, script: str, pinned: bool = False) -> Attack:
        return tried("streams", name, what, script, pinned)

    run = "$G run silo.yaml"
    yield of("no standard input", SILO, f"{run} <&-")
    yield of("no standard output", SILO, f"{run} >&-")
    yield of("no standard error", SILO, f"{run} 2>&-")
    yield of("the log on a full disk", SILO, f"{run} 2> /dev/full")
    for case in ("silo", "bed"):
        what, run = right(done(case)), f"$G run {case}.yaml"
        yield of(f"no streams, {case}", what, f"{run} <&- >&- 2>&-")
        yield of(f"the reader is gone, {case}", what, f"{{ {run}; echo $? > status; }} 2>&1 | true; exit $(cat status)")
    yield of("the output on a full disk", refused("[Nn]o space"), "$G run silo.yaml > /dev/full")
    yield of("the plan on a full disk", refused("[Nn]o space"), "$G plan silo.yaml > /dev/full")
    yield of("a plan of one line", right(lambda *_: ""), "$G plan silo.yaml | head -1; exit ${PIPESTATUS[0]}")
    for columns, rows in ((1, 1), (0, 0)):
        inside = f"stty cols {columns} rows {rows}; $G run bed.yaml"
        script = f"script -qec '{inside}' /dev/null < /dev/null"
        yield of(f"a terminal of {columns} × {rows}", right(done("bed")), script)


def signals() -> Iterator[Attack]:
    """Signals at every stage; afterwards the run goes on to the right end, and no process is left."""
    begun = "set -m; FAKE_PAUSE=0.1 bash -c 'trap - INT; exec $G run {}.yaml' & p=$!; "

    def sent(signal: str, after: float, status: str, case: str = "bed") -> Attack:
        ended = f"kill -{signal} $p; wait $p; s=$?; case $s in {status}|0|4) ;; *) echo status $s; exit 99;; esac; "
        script = f"{begun.format(case)} {BEGUN} sleep {after}; {ended} {NONE_LEFT} $G run {case}.yaml"
        return tried("signals", f"{signal} after {after} s, {case}", right(done(case)), script)

    for after in (0.0, 0.2, 0.5, 1.0, 2.0):
        yield sent("INT", after, "130", "silo")
    for after in (1.0, 3.0, 6.0):
        yield sent("INT", after, "130")
        yield sent("HUP", after, "129|130")
    yield sent("TERM", 5.0, "130|143")
    yield sent("TERM", 0.1, "130|143", "silo")
    yield sent("KILL", 5.0, "137")
    yield sent("QUIT", 4.0, "131|130")
    ended = f"{PRODUCING} for i in {{1..20}}; do kill -INT $p; done; wait $p; test $? = 130 || exit 99; "
    script = f"{begun.format('bed')} {ended} {NONE_LEFT} $G run bed.yaml"
    yield tried("signals", "INT twenty times", right(done("bed")), script)
    stopped = f"$G run bed.yaml & p=$!; {PRODUCING} kill -TSTP $p; sleep 1; kill -CONT $p; wait $p"
    yield tried("signals", "Ctrl-Z and on", right(done("bed")), stopped, FAKE_PAUSE="0.1")
    ignored = "trap '' CHLD PIPE INT HUP TSTP TERM; $G run bed.yaml"
    yield tried("signals", "all ignored by the parent", right(done("bed")), ignored)


def together() -> Iterator[Attack]:
    """Several commands at once."""

    def of(name: str, what: Right, script: str) -> Attack:
        return tried("together", name, what, script, FAKE_PAUSE="0.1")

    one, alone = (
        "$G run bed.yaml & p=$!; ",
        "s=$?; wait $p; t=$?; echo $s $t; test $s != $t || exit 99; $G run bed.yaml",
    )
    busy = right(done("bed"), "another granpipe")
    yield of("two runs of a case at once", busy, f"{one} $G run bed.yaml; {alone}")
    ten = "for i in {1..10}; do $G run silo.yaml & done; wait; $G run silo.yaml"
    yield of("ten runs of a fluid at once", SILO, ten)
    yield of("two cases at once", right(done("bed")), f"{one} $G run silo.yaml; wait $p")
    clean = f"{one} {PRODUCING} $G clean; test $? = 3 || exit 99; wait $p"
    yield of("clean during a run", right(done("bed"), "a run uses this store"), clean)
    clean = "$G run bed.yaml; $G clean & $G clean & wait; $G run bed.yaml"
    yield of("clean and clean at once", right(done("bed")), clean)
    scale = "$G scale results/silo --flow '1 m^3/h' --out scaled"
    script = f"$G run silo.yaml; for i in {{1..4}}; do {scale} & done; wait"
    yield of("scale four times at once", right(done(place="scaled"), "scaled"), script)
    if os.geteuid():
        return
    inside = "unshare -pf --kill-child --mount-proc $G run bed.yaml"
    yield of("two containers", busy, f"{inside} & p=$!; {inside}; {alone}")
    script = f"{inside} & p=$!; {PRODUCING} kill -KILL $p; sleep 0.3; {inside}"
    yield of("a container is killed", right(done("bed")), script)


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("\n", "\\n").replace("\x7f", "\\177").replace("'", "'\\''") + "'"
