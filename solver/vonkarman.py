"""Owns the cubic law of large deflection: von Kármán membrane energy with the in-plane field condensed out."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from solver.assembly import PlateMatrices
from solver.banded import upper_bands
from solver.bfs import bending_shape, gauss, inplane_shape
from solver.mesh import Floats

# A side. 7 points would be exact (degree 12). 4 are within 1e-5 of that for the modes (m,1) that carry flutter, and
# within 0.3 % for the highest of 24, which a limit cycle does not notice (tests/test_vonkarman.py measures both).
CUBIC_POINTS = 4


def index_pairs(modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Mode indices (r, s), r <= s, of the n(n+1)/2 pairs in the order that the cubic law uses."""
    return np.triu_indices(modes)


def pair_products(q: Floats) -> Floats:
    """(…, pairs) products c_(rs) = (2 - δ_rs) q_r q_s of modal amplitudes (…, modes)."""
    r, s = index_pairs(q.shape[-1])
    return q[..., r] * q[..., s] * np.where(r == s, 1.0, 2.0)


def condensed_energy(plate: PlateMatrices, modes: Floats, points: int = CUBIC_POINTS) -> Floats:
    """Matrix G of the quartic energy U4 = ½ cᵀ G c over pairs c = `pair_products(q)`.

    With w = Σ q_r φ_r the von Kármán strain is ε = B u + Σ c_p e_p. In-plane inertia is neglected, so that u minimises
    the energy ½ ∫ εᵀ A ε, and G = Eᵀ A E - (Bᵀ A E)ᵀ K_m⁻¹ (Bᵀ A E). This is the seed's (2.21) written as an energy.

    Args:
        plate: the plate of the design.
        modes: (free dofs, modes) bending shapes.
        points: Gauss points a side of an element.

    Returns:
        (pairs, pairs) symmetric positive semidefinite [J per (kg·m²)² for mass-normalised modes].
    """
    space, mesh = plate.space, plate.space.mesh
    s, weight = gauss(points)
    weights = np.kron(weight, weight) * mesh.hx * mesh.hy
    local = space.expand(modes)[mesh.bending_dofs]  # (elements, 16, modes)
    slope_x = bending_shape(mesh, s, s, 1, 0) @ local  # (elements, points², modes)
    slope_y = bending_shape(mesh, s, s, 0, 1) @ local
    r, t = index_pairs(modes.shape[1])
    strain = np.empty((mesh.elements, 3, len(weights), len(r)))
    np.multiply(slope_x[..., r], slope_x[..., t], out=strain[:, 0])
    np.multiply(slope_y[..., r], slope_y[..., t], out=strain[:, 1])
    np.add(slope_x[..., r] * slope_y[..., t], slope_y[..., r] * slope_x[..., t], out=strain[:, 2])

    # A = LᵀL an element turns both products below into one symmetric one each
    root = np.linalg.cholesky(plate.extension).transpose(0, 2, 1)
    scaled = np.matmul(root, strain.reshape(mesh.elements, 3, -1)).reshape(strain.shape)
    scaled *= 0.5 * np.sqrt(weights)[:, None]
    rows = scaled.reshape(-1, len(r))

    displacement = np.zeros((3, len(weights), 8))
    displacement[0, :, :4] = displacement[2, :, 4:] = inplane_shape(mesh, s, s, 1, 0)
    displacement[1, :, 4:] = displacement[2, :, :4] = inplane_shape(mesh, s, s, 0, 1)
    displacement *= np.sqrt(weights)[:, None]
    rooted = np.einsum("eab,bgi->eiag", root, displacement).reshape(mesh.elements, 8, -1)
    force = np.zeros((len(mesh.free_inplane), len(r)))
    np.add.at(force, mesh.inplane_dofs, np.matmul(rooted, scaled.reshape(mesh.elements, -1, len(r))))
    force = force[mesh.free_inplane]

    bands = scipy.linalg.cholesky_banded(upper_bands(plate.membrane))
    displaced = scipy.linalg.cho_solve_banded((bands, False), force)
    energy = rows.T @ rows - force.T @ displaced
    return (energy + energy.T) / 2


def cubic_force(energy: Floats, q: Floats) -> Floats:
    """Gradient of U4 at amplitudes q (modes,), f_r = 2 Σ_s (G c)_(rs) q_s: the plain form of the kernel's law."""
    modes = len(q)
    r, s = index_pairs(modes)
    stress = np.zeros((modes, modes))
    stress[r, s] = stress[s, r] = energy @ pair_products(q)
    return 2 * stress @ q
