"""Owns the sectors of a plate: all of its motions, or those of one parity about y = b/2, told by half the elements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sp

from solver.mesh import Floats, Ints, Mesh
from solver.pattern import Pattern

Parity = Literal[-1, 0, 1]
"""1 for motions symmetric about y = b/2, -1 for antisymmetric ones, 0 for all motions."""


@dataclass(frozen=True)
class Coordinates:
    """Orthonormal coordinates of a sector: each free dof is a factor times one of them, or stays zero."""

    number: Ints
    """(free dofs + 1,) coordinate that each free dof follows, -1 where it stays zero, as a held dof, the last, does."""
    factor: Floats
    """(free dofs + 1,) by what it follows [-]: 1, or ±√½ where its mirror image follows as well; 0 of the last."""
    size: int
    """Number of coordinates."""

    @cached_property
    def basis(self) -> sp.csr_array:
        """(free dofs, size) orthonormal basis of these motions."""
        moving = np.flatnonzero(self.number >= 0)
        entries = (self.factor[moving], (moving, self.number[moving]))
        return sp.csr_array(entries, shape=(len(self.number) - 1, self.size))


@dataclass(frozen=True)
class Sector:
    """Motions that a plate symmetric about y = b/2 keeps among themselves or, of parity 0, all motions of any plate.

    In those of one parity, elements that mirror each other do the same: one of them stands for both.
    """

    mesh: Mesh
    """The mesh, whose edges at y = 0 and y = b are alike unless the parity is 0."""
    parity: Parity
    """Which motions."""

    @cached_property
    def elements(self) -> Ints:
        """(m,) ids of the elements that tell of all: those on one side, and the row that lies across y = b/2."""
        rows = self.mesh.ny if self.parity == 0 else (self.mesh.ny + 1) // 2
        return np.arange(self.mesh.elements).reshape(self.mesh.nx, -1)[:, :rows].ravel()

    @cached_property
    def counts(self) -> Floats:
        """(m,) how many elements each of these stands for [-]."""
        row = self.elements % self.mesh.ny
        return np.where((self.parity == 0) | (2 * row == self.mesh.ny - 1), 1.0, 2.0)

    @cached_property
    def bending(self) -> Coordinates:
        """Coordinates of deflection."""
        # w and w,x keep their sign in the mirror, w,y and w,xy do not
        found = self._coordinates(self.mesh.bending_unknowns, np.array([1, 1, -1, -1]))
        assert found is not None  # edges that are alike hold the same dofs
        return found

    @cached_property
    def inplane(self) -> Coordinates | None:
        """Coordinates of displacement in the plane; None where a corner that is pinned alone breaks the symmetry."""
        return self._coordinates(self.mesh.inplane_unknowns, np.array([1, -1]))

    @cached_property
    def bending_pattern(self) -> Pattern:
        """Where bending matrices of the m elements land in one over the coordinates."""
        return self._pattern(self.bending, self.mesh.bending_unknowns, self.mesh.bending_dofs)

    @cached_property
    def inplane_pattern(self) -> Pattern:
        """Where in-plane matrices of the m elements land likewise."""
        assert self.inplane is not None
        return self._pattern(self.inplane, self.mesh.inplane_unknowns, self.mesh.inplane_dofs)

    @cached_property
    def inplane_places(self) -> tuple[Ints, Floats]:
        """(m, 8) coordinate that each in-plane dof of the m elements follows, -1 where none, and by what factor."""
        assert self.inplane is not None
        unknowns = self.mesh.inplane_unknowns[self.mesh.inplane_dofs[self.elements]]
        return self.inplane.number[unknowns], self.inplane.factor[unknowns]

    def _coordinates(self, unknowns: Ints, signs: Ints) -> Coordinates | None:
        """Coordinates of unknowns (k·nodes,), -1 where held, that a mirror turns into signs (k,) times their image."""
        mesh, size = self.mesh, int(unknowns.max(initial=-1)) + 1
        at = unknowns.reshape(mesh.nx + 1, mesh.ny + 1, -1)
        # numbered along the longer side, which keeps bands narrow
        order = at if mesh.nx >= mesh.ny else at.transpose(1, 0, 2)
        own = np.arange(size)
        image, sign = own.copy(), np.ones(size)
        if self.parity:
            image_at = at[:, ::-1]
            if np.any((at < 0) != (image_at < 0)):
                return None
            image[at[at >= 0]] = image_at[at >= 0]
            sign[at[at >= 0]] = self.parity * np.broadcast_to(signs, at.shape)[at >= 0]
        lone = image == own
        # a dof on the mirror line is its own image, and belongs to one of the two parities
        leads = np.where(lone, sign > 0, own < image)
        _, first = np.unique(order, return_index=True)
        place = np.argsort(first[-size:] if size else first)
        leading = place[leads[place]]
        number = np.full(size + 1, -1)
        number[leading] = np.arange(len(leading))
        follows = np.flatnonzero(~lone & ~leads)
        number[follows] = number[image[follows]]
        factor = np.where(lone, 1.0, np.where(leads, 1.0, sign) * np.sqrt(0.5)) * (number[:-1] >= 0)
        return Coordinates(number, np.append(factor, 0.0), len(leading))

    def _pattern(self, coordinates: Coordinates, unknowns: Ints, dofs: Ints) -> Pattern:
        factor = coordinates.factor[unknowns[dofs[self.elements]]]
        weights = None if self.parity == 0 else np.einsum("e,ei,ej->eij", self.counts, factor, factor)
        return Pattern.of(dofs[self.elements], coordinates.number[unknowns], weights)
