"""Owns buckling in still air: the factor on preload and heat at which the flat panel gives way."""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy.sparse as sp

from solver.assembly import PlateMatrices

ACCURACY = 1e-10  # relative, of the factor
KRYLOV = 40  # vectors, where the one eigenvalue that presses may hide behind many that pull
PATIENCE = 300  # restarts; what presses so little that it takes more is no buckling that anyone will see
NOTHING = 1e-6  # of the strongest pull: less compression than this is rounding


def buckling_factor(plate: PlateMatrices) -> float | None:
    """Smallest positive factor on the plate's stresses before deflection at which it buckles, with every mode.

    (K + s K_N) φ = 0 is solved as -K_N φ = K φ / s. Times the loads of the design, the factor gives the buckling load:
    a temperature rise of factor · ΔT, where heat is all there is.

    Returns:
        s [-]; None where nothing presses, or everything pulls.
    """
    if plate.prestress is None or plate.geometric is None or _pulls(plate):
        return None
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    stiffness, _ = plate.linear(loaded=False)
    pressing = plate.widened(sp.csr_array(-plate.geometric))
    factor = spla.splu(stiffness.tocsc())
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=np.float64)
    start = factor.solve(pressing @ np.random.default_rng(0).standard_normal(stiffness.shape[0]))
    if not start.any():
        return None

    def extreme(which: Literal["LM", "LA"]) -> float:
        """Eigenvalue 1/s of largest modulus, or the largest."""
        values = spla.eigsh(
            pressing,
            1,
            stiffness,
            which=which,
            Minv=inverse,
            v0=start,
            ncv=KRYLOV,
            maxiter=PATIENCE,
            tol=ACCURACY,
            return_eigenvectors=False,
        )
        return float(values[0])

    try:
        strongest = extreme("LM")
        most = strongest if strongest > 0 else extreme("LA")
    except spla.ArpackNoConvergence:
        return None
    return 1 / most if most > NOTHING * abs(strongest) else None


def _pulls(plate: PlateMatrices) -> bool:
    """Whether no direction anywhere on the plate is in compression."""
    assert plate.prestress is not None
    x, y, xy = np.moveaxis(plate.prestress, -1, 0)
    return bool(np.all(x >= 0) and np.all(y >= 0) and np.all(x * y >= xy**2))
