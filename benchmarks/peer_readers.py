"""Read one snapshot with OVITO and with pandas; prints seconds as JSON. Runs in an environment of its own.

Arguments: binary dump, text dump, number of repetitions.
"""

import json
import sys
import time
from pathlib import Path

import pandas
from ovito.io import import_file

binary, text, repetitions = sys.argv[1], sys.argv[2], int(sys.argv[3])
COLUMNS = ["Particle Identifier", "Particle Type", "Position.X", "Position.Y", "Position.Z"]
COLUMNS += ["Velocity.X", "Velocity.Y", "Velocity.Z", "Radius"]


def with_ovito(path, **options):
    # a new pipeline each time: nothing of the file is kept from the last
    return import_file(path, **options).compute().particles.count


def with_pandas(engine):
    with Path(text).open() as file:
        names = next(line for line in file if line.startswith("ITEM: ATOMS")).split()[2:]
    # every line ends with a space: one more column, empty
    return len(pandas.read_csv(text, sep=" ", engine=engine, skiprows=9, names=[*names, "end"], header=None))


def best(task):
    times = []
    for _ in range(repetitions):
        begun = time.perf_counter()
        count = task()
        times.append(time.perf_counter() - begun)
    return {"seconds": min(times), "particles": count}


print(
    json.dumps(
        {
            "OVITO, binary": best(lambda: with_ovito(binary, columns=COLUMNS)),
            "OVITO, text": best(lambda: with_ovito(text)),
            "pandas, text": best(lambda: with_pandas("c")),
            "pandas with pyarrow, text": best(lambda: with_pandas("pyarrow")),
        }
    )
)
