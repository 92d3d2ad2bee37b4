"""Direct solution of sparse symmetric systems, in an elimination order given from outside.

MKL's PARDISO, tried once each on six Stokes systems of the hopper (3 000 to 113 000 unknowns, one thread, its own
order), took 1.9 to 3.5 times the CPU time of SuperLU in METIS's order.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from granpipe.errors import SolveError
from granpipe.field import Array
from granpipe.rzmesh import Index

MOST_REFINEMENTS = 10
LARGEST_RESIDUAL = 1e-8


def solve_ordered(matrix: Any, right: Array, order: Index, shift: Array) -> tuple[Array, float]:
    """Solve with pivots from the diagonal, and refine.

    Parameters
    ----------
    matrix : (n, n) sparse, symmetric
    right : (n,)
    order : the unknowns in the order of elimination; those left out are 0
    shift : (n,) taken from the diagonal for the factorisation only, where a pivot might vanish

    Returns
    -------
    The solution (n,) and its largest residual over the largest entry of `right`; SolveError where that is above 1e-8.
    """
    inner = sparse.csc_array(matrix[order][:, order])
    shifted = sparse.csc_array(inner - sparse.diags_array(shift[order]))
    options = {"SymmetricMode": True}
    try:
        factors = linalg.splu(shifted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)
    except RuntimeError as error:
        raise SolveError(f"the system of {len(right)} unknowns is singular ({error})") from error
    solution = np.zeros(len(right))
    solution[order], residual = _refine(factors, inner, right[order])
    if not residual < LARGEST_RESIDUAL:
        raise SolveError(f"the system of {len(right)} unknowns was solved to a residual of only {residual:.2g}")
    return solution, residual


def _refine(factors: Any, matrix: Any, right: Array) -> tuple[Array, float]:
    """Solution by iterative refinement, for as long as each step at least halves the residual, and that residual."""
    solution, rest = np.zeros(len(right)), right
    scale = float(np.abs(right).max()) or 1.0
    residual = 1.0
    for _ in range(MOST_REFINEMENTS):
        better = solution + factors.solve(rest)
        rest = right - matrix @ better
        size = float(np.abs(rest).max()) / scale
        if not size < residual:
            break
        gain, solution, residual = residual / size if size else np.inf, better, size
        if gain < 2:
            break
    return solution, residual
