"""Owns a row of the validation table, and the designs that its rows are about."""

from __future__ import annotations

from dataclasses import dataclass

from solver.design import Basis, Design, Flow, Load, MeshSize, Panel, Patches, Reduction

PATCHED = tuple(i * 6 + j for i in (3, 4, 5) for j in (2, 3))
"""The six elements i = 3..5, j = 2..3 of the 24 × 6 mesh."""


@dataclass(frozen=True)
class Case:
    """One row of the validation table; every field is plain and goes into JSON as it is."""

    name: str
    """What is compared, with its unit."""
    value: float | None
    """This solver's number [unit in the name]; None if it found none, as no flutter."""
    reference: float
    """The independent number [same unit]."""
    tol: float
    """Relative tolerance [-]."""
    ok: bool
    """Whether the value lies within the tolerance of the reference; the paper's number has no say in it."""
    seed: float | None
    """The paper's own printed number [same unit], where it has one."""
    source: str
    """Who computed the reference."""


def case_of(
    name: str, value: float | None, reference: float, tol: float, source: str, seed: float | None = None
) -> Case:
    """The row of a value and its reference."""
    value = None if value is None else float(value)
    ok = value is not None and abs(value - reference) <= tol * abs(reference)  # NaN is not within anything
    return Case(name, value, float(reference), float(tol), bool(ok), seed, source)


def design_of(
    modes: int = 24,
    basis: Basis = "patched",
    damping: float = 0.0,
    mesh: tuple[int, int] = (24, 6),
    panel: Panel | None = None,
    elements: tuple[int, ...] = (),
    load: Load | None = None,
) -> Design:
    """The seed's panel, or another, without damping unless asked for."""
    return Design(
        panel=panel or Panel(),
        mesh=MeshSize(*mesh),
        flow=Flow(damping=damping),
        load=load or Load(),
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )
