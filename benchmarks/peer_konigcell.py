"""Deposit spheres onto 3-D voxels with KonigCell; prints seconds as JSON. Runs in an environment of its own.

Arguments: ``.npz`` with position (n, 3), radius (n,), limits (3, 2), cells (3,).
"""

import json
import sys
import time

import konigcell
import numpy as np

data = np.load(sys.argv[1])


def deposit(count):
    limits = data["limits"]
    return konigcell.static3d(
        data["position"][:count],
        konigcell.INTERSECTION,
        radii=data["radius"][:count],
        resolution=tuple(int(cells) for cells in data["cells"]),
        xlim=list(limits[0]),
        ylim=list(limits[1]),
        zlim=list(limits[2]),
        max_workers=1,
        verbose=False,
    )


deposit(10)
begun = time.perf_counter()
voxels = deposit(len(data["radius"]))
seconds = time.perf_counter() - begun
volume = 4 / 3 * np.pi * (data["radius"] ** 3).sum()
print(json.dumps({"seconds": seconds, "volume_ratio": float(np.asarray(voxels.voxels).sum() / volume)}))
