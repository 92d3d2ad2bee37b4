"""Fields that only single particles tell: granular temperature, coordination, mixing of sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array, Grid, Particles
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.bins import Bins
from granpipe.homogenize.extras import Arrays, measured, measured_together

LEAST_SAMPLES = 20
"""Particles in a window, over all snapshots, from which a temperature or a coordination number is told."""

SAMPLE_DIAMETERS = 3
"""Edge length of the cubes whose composition the mixing index compares, in particle diameters: some 30 particles."""

_FITTED = 3  # numbers of a linear velocity: its mean and two gradients
_SINGULAR = 1e-9


def velocity_moments(bins: Bins, particles: Particles) -> Arrays:
    """``moments`` (20, bz, br) of one snapshot, as a value for `Collector.observe`.

    Of the particles centred in each bin: their number, ΣV, ΣV²; ΣV times r, z, r², rz, z², in widths of a bin; then for
    the velocities along r, round the axis and along z ΣVv, ΣVvr, ΣVvz, ΣVv². V is a particle's volume. In the plane
    x–z these are x, and the velocities along x, y and z.
    """
    position, velocity = particles.position, particles.velocity
    volume = particles.radius**3
    measure, z = bins.grid.measure, position[:, 2]
    distance = measure.across(position[:, 0], position[:, 1])
    size = bins.factor * bins.grid.cell
    r, up = distance / size, (z - bins.grid.z_edges[0]) / size
    columns = [np.ones(len(z)), volume, volume**2, volume * r, volume * up]
    columns += [volume * r * r, volume * r * up, volume * up * up]
    for v in measure.components(position, velocity):
        columns += [volume * v, volume * v * r, volume * v * up, volume * v * v]
    return {"moments": bins.sums(distance, z, np.array(columns))}


def temperature_arrays(segments: Sequence[Sums], bins: Bins) -> Arrays:
    """Granular temperature T = ⟨|v − u|²⟩/3 by mass, and its standard error, in every cell [m²/s²].

    u is the mean velocity of the average, at the place of each particle: a straight line through the velocities in the
    window, so that its gradient there does not count as a fluctuation. NaN where too few particles were.

    Raises
    ------
    DataError : the segments hold no moments
    """

    def temperature(sums: Sums) -> Array:
        return bins.on_cells(_residual_variance(bins.window(sums.extra["moments"])))

    return measured("granular_temperature", segments, temperature)


def _residual_variance(moments: Array) -> Array:
    """(bz, br) variance per direction about straight lines through the velocities, less what fitting these takes."""
    number, weight, squares = moments[:3]
    some = number >= LEAST_SAMPLES
    place, mean = moments[3:5], moments[3:5] / np.where(some, weight, 1)
    spread = np.empty((*number.shape, 2, 2))
    for (i, j), moment in zip(((0, 0), (0, 1), (1, 1)), moments[5:8], strict=True):
        spread[..., i, j] = spread[..., j, i] = np.where(some, moment - place[i] * mean[j], 0)
    inverse = np.linalg.pinv(spread, rcond=_SINGULAR, hermitian=True)
    total = np.zeros(number.shape)
    for k in range(3):
        first, *along, square = moments[8 + 4 * k : 12 + 4 * k]
        slope = np.stack([one - first * at for one, at in zip(along, mean, strict=True)], axis=-1)
        explained = np.einsum("...i,...ij,...j", slope, inverse, slope)
        left = square - first**2 / np.where(some, weight, 1) - explained
        total += np.maximum(left, 0)
    effective = np.where(some, weight**2 / np.where(some, squares, 1), np.inf)
    variance = total / (3 * np.where(some, weight, 1)) / (1 - _FITTED / np.maximum(effective, _FITTED + 1))
    return np.where(some, variance, np.nan)


def contact_counts(bins: Bins, particles: Particles) -> Arrays:
    """``contacts`` (4, bz, br) of one snapshot, as a value for `Collector.observe`.

    Of the particles centred in each bin: their number, that of their contacts, and how many have none, and one. Spheres
    that overlap are in contact, across periodic faces too; walls do not count.
    """
    from scipy.spatial import cKDTree

    position, radius = particles.position, particles.radius
    near, period = 2 * float(radius.max(initial=0)), bins.grid.period
    if period:
        position = position.copy()
        position[:, 1] %= period
    tree = cKDTree(position, boxsize=(0.0, period, 0.0)) if period else cKDTree(position)
    one, other = tree.query_pairs(near, output_type="ndarray").T
    apart = position[one] - position[other]
    if period:
        apart[:, 1] -= period * np.round(apart[:, 1] / period)
    touching = (apart**2).sum(axis=1) < (radius[one] + radius[other]) ** 2
    count = np.bincount(np.concatenate([one[touching], other[touching]]), minlength=len(radius))
    columns = np.array([np.ones(len(count)), count, count == 0, count == 1], dtype=float)
    return {"contacts": bins.sums(bins.grid.measure.across(*position[:, :2].T), position[:, 2], columns)}


def coordination_arrays(segments: Sequence[Sums], bins: Bins) -> Arrays:
    """Contacts per particle in every cell; NaN where too few particles were.

    ``coordination`` of all particles; ``mechanical_coordination`` without those of fewer than two contacts, which bear
    nothing: (Σ Z − N₁)/(N − N₀ − N₁), Thornton, Géotechnique 50 (2000) 43; ``rattlers``, their part (N₀ + N₁)/N.

    Raises
    ------
    DataError : the segments hold no numbers of contacts
    """

    def all_of(sums: Sums) -> Array:
        number, contacts, none, single = bins.window(sums.extra["contacts"])
        bearing = number - none - single
        some = number >= LEAST_SAMPLES
        tops, bottoms = (contacts, contacts - single, none + single), (number, bearing, number)
        parts = [
            np.divide(top, bottom, out=np.full(number.shape, np.nan), where=some & (bottom > 0))
            for top, bottom in zip(tops, bottoms, strict=True)
        ]
        return bins.on_cells(np.array(parts))

    return measured_together(("coordination", "mechanical_coordination", "rattlers"), segments, all_of)


def mixing_sums(grid: Grid, radii: Array, diameter: float, particles: Particles) -> Arrays:
    """``mixing`` (2, slabs + 1) of one snapshot: N(S₀² − S²) and N(S₀² − S_r²) of every slab, and of the whole.

    The particles are counted in cubes of `SAMPLE_DIAMETERS` in space. With n_k of N particles in class k, and n_bk of
    n_b in cube b: S₀² = 1 − Σ(n_k/N)², S² = Σ n_b Σ_k (n_bk/n_b − n_k/N)² / N, and S_r², what S² is on average where
    the same particles lie at random in the same places, is S₀² (B − 1)/(N − 1) with B cubes that hold particles.
    """
    size = SAMPLE_DIAMETERS * diameter
    z = particles.position[:, 2]
    there = (z >= grid.z_edges[0]) & (z < grid.z_edges[-1])
    count = slabs(grid, diameter)
    x, y = np.floor(particles.position[there, :2].T / size).astype(np.int64)
    slab = np.minimum(((z[there] - grid.z_edges[0]) / size).astype(np.int64), count - 1)
    member = np.abs(particles.radius[there, None] - radii).argmin(axis=1)
    across = int(np.abs([x, y]).max(initial=0)) + 1
    key = (slab * 2 * across + x + across) * 2 * across + y + across
    _, first, cube = np.unique(key, return_index=True, return_inverse=True)
    held = np.zeros((len(first), len(radii)))
    np.add.at(held, (cube, member), 1.0)
    return {"mixing": np.column_stack([_lacey(held, slab[first], count), _lacey(held, 0 * first, 1)])}


def _lacey(held: Array, part: NDArray[np.int64], parts: int) -> Array:
    """(2, parts) N(S₀² − S²) and N(S₀² − S_r²) of the cubes (b, classes) of each part."""
    of_class = np.zeros((parts, held.shape[1]))
    np.add.at(of_class, part, held)
    number, cubes = of_class.sum(axis=1), np.bincount(part, minlength=parts)
    own = np.bincount(part, (held**2).sum(axis=1) / held.sum(axis=1), parts)
    none = np.maximum(number, 1)
    separate = number - (of_class**2).sum(axis=1) / none
    spread = own - (of_class**2).sum(axis=1) / none
    return np.array([separate - spread, separate * (1 - (cubes - 1) / np.maximum(number - 1, 1)) * (number > 1)])


def slabs(grid: Grid, diameter: float) -> int:
    """Number of slabs of cubes over the height of a grid; what is left at the top belongs to the last one."""
    return max(1, int((grid.z_edges[-1] - grid.z_edges[0]) / (SAMPLE_DIAMETERS * diameter)))


def mixing_arrays(segments: Sequence[Sums], grid: Grid, diameter: float, inside_fraction: Array) -> Arrays:
    """Lacey's mixing index of the slab that each cell lies in: 0 sizes wholly apart, 1 as at random.

    Lacey, J. Appl. Chem. 4 (1954) 257: M = (S₀² − S²)/(S₀² − S_r²). NaN in slabs of one size alone, and outside.

    Raises
    ------
    DataError : the segments hold no counts of sizes
    """
    rows = ((grid.z_centres - grid.z_edges[0]) / (SAMPLE_DIAMETERS * diameter)).astype(np.int64)
    slab = np.minimum(rows, slabs(grid, diameter) - 1)

    def index(sums: Sums) -> Array:
        return np.where(inside_fraction > 0, _index(sums)[slab][:, None], np.nan)

    return measured("mixing_index", segments, index)


def whole_mixing(segments: Sequence[Sums]) -> float:
    """Mixing index of all that is on the grid, heights among each other included.

    Raises
    ------
    DataError : the segments hold no counts of sizes
    """
    return float(_index(merge(segments))[-1])


def _index(sums: Sums) -> Array:
    if "mixing" not in sums.extra:
        raise DataError("these segment sums hold no counts of sizes; run again")
    top, bottom = sums.extra["mixing"]
    return np.asarray(np.divide(top, bottom, out=np.full(len(top), np.nan), where=bottom > 0))
