"""Owns the summing of element matrices and vectors into global ones, by patterns that are made once for a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from solver.mesh import Floats, Ints

Indices = NDArray[np.int32]  # what scipy's sparse matrices hold: others they would convert at each use


@dataclass(frozen=True)
class Pattern:
    """Where element matrices land in a global sparse matrix over free dofs; computed once for a mesh."""

    size: int
    """Number of free dofs."""
    indptr: Indices
    """(size + 1,) row pointers of the CSR matrix."""
    indices: Indices
    """(nonzeros,) column indices."""
    slot: Ints
    """(elements·k·k,) position of every element-matrix entry among the nonzeros; one past the end where held."""
    weights: Floats | None = None
    """(elements, k, k) what every entry is multiplied by [-]; None where that is 1."""

    @staticmethod
    def of(dofs: Ints, unknowns: Ints, weights: Floats | None = None) -> Pattern:
        """The pattern of elements with the given (elements, k) dofs, whose unknowns are numbered, -1 where held."""
        size = int(unknowns.max(initial=-1)) + 1
        number = unknowns[dofs]
        row, column = np.broadcast_arrays(number[:, :, None], number[:, None, :])
        held = (row < 0) | (column < 0)
        keys, slot = np.unique(np.where(held, size * size, row * size + column), return_inverse=True)
        keys = keys[keys < size * size]
        indptr = np.searchsorted(keys, np.arange(size + 1) * size)
        return Pattern(size, indptr.astype(np.int32), (keys % size).astype(np.int32), slot.ravel(), weights)

    def matrix(self, blocks: Floats) -> sp.csr_array:
        """Sum (elements, k, k) element matrices into a (size, size) matrix."""
        return sp.csr_array((self._summed(blocks), self.indices, self.indptr), shape=(self.size, self.size))

    def bands(self, blocks: Floats) -> Floats:
        """Sum symmetric (elements, k, k) element matrices into LAPACK's upper bands (width + 1, size)."""
        upper, place = self._upper
        bands = np.zeros((self.size, self.width + 1))  # a column of LAPACK's, which are contiguous, is a row here
        bands.ravel()[place] = self._summed(blocks)[upper]
        return bands.T

    @cached_property
    def width(self) -> int:
        """Number of bands above the diagonal."""
        return int((self.indices - self._rows).max(initial=0))

    @cached_property
    def _rows(self) -> Ints:
        """(nonzeros,) row indices."""
        return np.repeat(np.arange(self.size), np.diff(self.indptr))

    @cached_property
    def _upper(self) -> tuple[Ints, Ints]:
        """Nonzeros on and above the diagonal, and their places in the bands, column by column."""
        upper = np.flatnonzero(self.indices >= self._rows)
        row, column = self._rows[upper], self.indices[upper]
        return upper, column * (self.width + 1) + self.width + row - column

    def _summed(self, blocks: Floats) -> Floats:
        """(nonzeros,) sums of the elements' entries."""
        entries = blocks if self.weights is None else blocks * self.weights
        count = len(self.indices)
        return np.bincount(self.slot, weights=entries.ravel(), minlength=count + 1)[:count].astype(float, copy=False)


def scatter(number: Ints, blocks: Floats, size: int) -> Floats:
    """Sum element vectors (elements, k, …) into one (size, …) by their unknowns' numbers, leaving out those of -1."""
    total = np.zeros((size + 1, *blocks.shape[2:]))
    np.add.at(total, number, blocks)
    return total[:-1]
