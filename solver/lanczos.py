"""Owns Lanczos' method: the lowest eigenpairs of a symmetric definite pencil from the inverse of its stiffness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from solver.mesh import Floats

STARTS = 2  # vectors to start from: of a double eigenvalue, as a square panel has them, both eigenvectors show
ACCURACY = 1e-14  # of 1/ω², relative: the residual at which a pair is done
LOOK, LOOK_EACH, STRIDE = 21, 2.4, 5  # steps before the first look, more of them a pair, and from one look to the next


def lowest_pairs(
    inverse: Callable[[Floats], Floats], mass: Callable[[Floats], Floats], size: int, count: int
) -> tuple[Floats, Floats]:
    """The `count` lowest eigenpairs of K x = ω² M x.

    Lanczos' method for K⁻¹M, which is self-adjoint in the inner product of M: in Ruhe's band form (Math. Comp. 33,
    1979), with full orthogonalisation and without restarts. It starts from the same vectors always, so that the same
    matrices give the same bits.

    Args:
        inverse: x (size,) -> K⁻¹x.
        mass: x (size,) -> Mx.
        size: order of K and M.
        count: how many pairs, few against the size.

    Returns:
        ω² (count,) in ascending order, and vectors (size, count) with XᵀMX = I.

    Raises:
        numpy.linalg.LinAlgError: K or M is not positive definite.
    """
    look = LOOK + int(LOOK_EACH * count)
    basis = _Basis(mass, np.random.default_rng(0).standard_normal((min(STARTS, size), size)), room=look + 4 * STRIDE)
    while basis.steps < size:
        basis.extend(inverse)
        if basis.steps < min(look, size):
            continue
        look += STRIDE
        values, vectors = np.linalg.eigh(basis.projected)
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        residual = np.linalg.norm(basis.outside.T @ vectors, axis=0)
        if np.all(residual <= ACCURACY * values):
            return 1 / values, basis.vectors.T @ vectors
    raise np.linalg.LinAlgError("eigenvalues do not converge")


class _Basis:
    """Vectors v, orthonormal in the inner product of M, and T = K⁻¹M in them as far as it was applied."""

    def __init__(self, mass: Callable[[Floats], Floats], starts: Floats, room: int) -> None:
        self._mass = mass
        self.size = self.steps = 0
        self._rows, self._duals = np.empty((2, room, starts.shape[1]))  # v and Mv
        self._images = np.zeros((room, room))  # of each v, Tv in the basis
        for start in starts:
            self._append(start, self.size, np.zeros(room))

    @property
    def vectors(self) -> Floats:
        """(steps, n) the vectors that T was applied to."""
        return self._rows[: self.steps]

    @property
    def projected(self) -> Floats:
        """(steps, steps) vᵀM T v."""
        return self._images[: self.steps, : self.steps]

    @property
    def outside(self) -> Floats:
        """(steps, STARTS) the part of each T v in the vectors that T was not applied to yet."""
        return self._images[: self.steps, self.steps : self.size]

    def extend(self, inverse: Callable[[Floats], Floats]) -> None:
        """Apply T to one vector more, and take what is new in the result into the basis."""
        if self.size == len(self._rows):
            self._rows, self._duals, self._images = (
                np.pad(known, [(0, self.size), (0, more)])
                for known, more in ((self._rows, 0), (self._duals, 0), (self._images, self.size))
            )
        # in exact arithmetic that has a share in the neighbours alone
        k = self.steps
        image = inverse(self._duals[k])
        if self.size < len(image):
            self._append(image, max(k - STARTS, 0), self._images[k])
        else:
            self._images[k, : self.size] = self._duals[: self.size] @ image
        self.steps += 1

    def _append(self, vector: Floats, near: int, share: Floats) -> None:
        """Make a vector orthonormal and keep it, on those from a near one on before all, and its shares in them."""
        n = self.size
        rows, duals = self._rows[:n], self._duals[:n]
        share[near:n] = duals[near:] @ vector
        vector = vector - share[near:n] @ rows[near:]
        while True:
            part = duals @ vector
            vector -= part @ rows
            share[:n] += part
            image = self._mass(vector)
            square = float(vector @ image)
            if not square > 0:
                raise np.linalg.LinAlgError("not positive definite")
            if part @ part <= square:  # else most was taken off, and what is left holds the rounding of that
                break
        share[n] = norm = np.sqrt(square)
        np.divide(vector, norm, out=self._rows[n])
        np.divide(image, norm, out=self._duals[n])
        self.size += 1
