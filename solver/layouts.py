"""Owns the sets of elements that a search goes through: rectangles, mirrored pairs, what a task allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

from solver.design import Design
from solver.mesh import Mesh
from solver.piezo import channels
from solver.ranking import design_with
from solver.task import Task

Layout = tuple[int, ...]
"""Ids of patched elements, in ascending order."""


def layout(elements: Sequence[int]) -> Layout:
    """Elements in ascending order, each once."""
    return tuple(sorted(set(elements)))


def union(units: Sequence[Layout]) -> Layout:
    """The elements of several units together."""
    return layout(list(chain.from_iterable(units)))


def units_of(mesh: Mesh, task: Task) -> list[Layout]:
    """What a task patches or leaves bare as one: elements, or where it is symmetric, pairs that mirror each other."""
    bare = set(task.keep_out)
    if not task.symmetric:
        return [(e,) for e in range(mesh.elements) if e not in bare]
    pairs = {union([(e,), mesh.mirror_image((e,))]) for e in range(mesh.elements)}
    return sorted(pair for pair in pairs if not bare & set(pair))


def most_elements(design: Design, task: Task) -> int:
    """How many elements the limits on number and mass allow at most, of those that may be patched."""
    mesh = Mesh.of(design.panel, design.mesh)
    count = sum(len(unit) for unit in units_of(mesh, task))
    if task.elements is not None:
        count = min(count, task.elements)
    if task.mass is not None:
        count = min(count, int(task.mass / patch_mass(design) * (1 + 1e-12)))
    return count


def patch_mass(design: Design) -> float:
    """What a pair of layers on one element weighs [kg]."""
    mesh, patches = Mesh.of(design.panel, design.mesh), design.patches
    return 2 * patches.ceramic.density * patches.thickness * mesh.hx * mesh.hy


def allowed(design: Design, task: Task, elements: Layout) -> bool:
    """Whether a task allows a layout."""
    mesh = Mesh.of(design.panel, design.mesh)
    return (
        0 < len(elements) <= most_elements(design, task)
        and not set(task.keep_out) & set(elements)
        and (not task.symmetric or mesh.mirror_image(elements) == elements)
        and (task.channels is None or len(channels(design_with(design, task, elements))) <= task.channels)
    )


def shapes_of(mesh: Mesh, task: Task) -> Iterator[Layout]:
    """Rectangles, pairs of rectangles that mirror each other about y = b/2, or both, as a task names them.

    Every rectangle comes, or where the task is symmetric, every one that mirrors itself. A pair has a bare row between
    its two, for else it is a rectangle.
    """
    spans = [(first, last) for first in range(mesh.nx) for last in range(first, mesh.nx)]
    rows = [(first, last) for first in range(mesh.ny) for last in range(first, mesh.ny)]
    for low, high in spans:
        for first, last in rows:
            one = tuple(i * mesh.ny + j for i in range(low, high + 1) for j in range(first, last + 1))
            if task.shapes != "pairs" and (not task.symmetric or first + last == mesh.ny - 1):
                yield one
            if task.shapes != "rectangles" and mesh.ny - 1 - 2 * last >= 2:
                yield union([one, mesh.mirror_image(one)])
