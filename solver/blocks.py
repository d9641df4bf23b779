"""Owns the split of a square matrix into diagonal blocks that nothing ties to each other."""

from __future__ import annotations

import numpy as np

from solver.mesh import Bools, Ints


def blocks_of(coupled: Bools) -> list[Ints]:
    """Indices of each block of a matrix, in ascending order, by their smallest.

    Args:
        coupled: (n, n) where the matrix is not zero.
    """
    tied = coupled | coupled.T | np.eye(len(coupled), dtype=bool)
    left = np.ones(len(coupled), dtype=bool)
    found = []
    while left.any():
        block = tied[np.argmax(left)]
        while np.count_nonzero(wider := tied[block].any(axis=0)) > np.count_nonzero(block):
            block = wider
        found.append(np.flatnonzero(block))
        left &= ~block
    return found
