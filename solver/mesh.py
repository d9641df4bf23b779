"""Owns the rectangular grid of elements: numbering, coordinates, degrees of freedom and what the edges hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.design import MeshSize, Panel

Floats = NDArray[np.floating]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Mesh:
    """A uniform nx × ny grid on [0, a] × [0, b].

    Element (i, j), i downstream and j across, has id i·ny + j; node (i, j) has id i·(ny + 1) + j. A node carries the
    four bending dofs (w, w,x, w,y, w,xy) at 4n..4n+3 and the two in-plane dofs (u, v) at 2n, 2n+1.
    """

    length: float
    """a [m]."""
    width: float
    """b [m]."""
    nx: int
    """Elements along x."""
    ny: int
    """Elements along y."""
    edges: str
    """Edges at x = 0, x = a, y = 0, y = b: s simply supported, c clamped, f free."""
    held: str = "iiii"
    """The same edges in their plane: i immovable, n held along the normal, s straight, f free."""

    @staticmethod
    def of(panel: Panel, size: MeshSize) -> Mesh:
        """The mesh of a panel."""
        return Mesh(panel.length, panel.width, size.nx, size.ny, panel.edges, panel.held)

    @property
    def hx(self) -> float:
        """Element length [m]."""
        return self.length / self.nx

    @property
    def hy(self) -> float:
        """Element width [m]."""
        return self.width / self.ny

    @property
    def elements(self) -> int:
        """Number of elements."""
        return self.nx * self.ny

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return (self.nx + 1) * (self.ny + 1)

    @cached_property
    def element_nodes(self) -> Ints:
        """(elements, 2, 2) node ids of each element, indexed by the corner's position in x, then in y."""
        i, j = np.divmod(np.arange(self.elements), self.ny)
        corner = np.array([[0, 1], [self.ny + 1, self.ny + 2]])
        return (i * (self.ny + 1) + j)[:, None, None] + corner

    @cached_property
    def bending_dofs(self) -> Ints:
        """(elements, 16) bending dofs of each element in the order of `bfs.bending_shape`."""
        component = np.array([[0, 2], [1, 3]])  # [derivative in x, derivative in y] -> w, w,x, w,y, w,xy
        dofs = 4 * self.element_nodes[:, :, None, :, None] + component[:, None, :]
        return dofs.reshape(self.elements, 16)

    @cached_property
    def inplane_dofs(self) -> Ints:
        """(elements, 8) in-plane dofs of each element: u at the four corners, then v."""
        corners = 2 * self.element_nodes.reshape(self.elements, 4)
        return np.hstack([corners, corners + 1])

    @cached_property
    def free_bending(self) -> Bools:
        """(4·nodes,) bending dofs that the edges leave free."""
        free = np.ones((self.nx + 1, self.ny + 1, 4), dtype=bool)
        # w = 0 along an edge holds w and its derivative along the edge; a clamp holds the two across it too
        for side, letter in enumerate(self.edges):
            if letter == "f":
                continue
            line = [free[0], free[-1], free[:, 0], free[:, -1]][side]
            along, across = (2, 1) if side < 2 else (1, 2)
            line[:, [0, along]] = False
            if letter == "c":
                line[:, [across, 3]] = False
        return free.ravel()

    @cached_property
    def bending_unknowns(self) -> Ints:
        """(4·nodes,) number of each bending dof among the free ones, -1 where it is held."""
        return np.where(self.free_bending, np.cumsum(self.free_bending) - 1, -1)

    @cached_property
    def inplane_unknowns(self) -> Ints:
        """(2·nodes,) number of each in-plane dof among the unknowns; -1 where held, one number along a straight edge.

        Where the edges leave the panel free to move as a rigid body, as many dofs of its corners are held as stop
        that: the membrane's loads balance one another, so that nothing pulls at them.
        """
        owner = np.arange(2 * self.nodes).reshape(self.nx + 1, self.ny + 1, 2)
        for side, kind in enumerate(self.held):
            line = [owner[0], owner[-1], owner[:, 0], owner[:, -1]][side]
            normal = side // 2
            if kind == "i":
                line[:] = -1
            elif kind == "n":
                line[:, normal] = -1
            elif kind == "s":
                line[:, normal] = line[0, normal]
        # a rigid motion along an axis is stopped by an edge across it that is held, or any that is immovable
        for axis in (0, 1):
            if "i" not in self.held and "n" not in self.held[2 * axis : 2 * axis + 2]:
                owner[owner == owner[0, 0, axis]] = -1
        if self.held == "ffff":
            owner[-1, 0, 1] = -1
        owners, number = np.unique(owner, return_inverse=True)
        return number.ravel() - (1 if owners[0] == -1 else 0)

    def connected_groups(self, elements: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Split element ids into groups that hang together by shared edges, each and all in ascending order."""
        left = set(elements)
        groups = []
        for first in sorted(elements):
            group, edge = set[int](), left & {first}
            while edge:
                group |= edge
                left -= edge
                edge = left & {other for e in edge for other in self._neighbours(e)}
            if group:
                groups.append(tuple(sorted(group)))
        return groups

    def _neighbours(self, element: int) -> list[int]:
        """Ids across the edges of an element; upstream and downstream of the panel there are numbers that are none."""
        across = [element - 1] * (element % self.ny > 0) + [element + 1] * (element % self.ny < self.ny - 1)
        return [element - self.ny, element + self.ny, *across]

    def mirror_image(self, elements: tuple[int, ...]) -> tuple[int, ...]:
        """The elements across y = b/2 from the given ones, in ascending order."""
        return tuple(sorted(e // self.ny * self.ny + self.ny - 1 - e % self.ny for e in elements))

    def element_at(self, x: float, y: float) -> int | None:
        """Id of the element over the point (x, y) [m], or None off the panel."""
        if not (0 <= x <= self.length and 0 <= y <= self.width):
            return None
        i = min(int(x / self.hx), self.nx - 1)
        return i * self.ny + min(int(y / self.hy), self.ny - 1)
