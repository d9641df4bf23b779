"""Owns the controlled panels that several tests share: presets with another λ, wiring, basis or controller."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

import control
import msgspec
import numpy as np
from numpy.typing import NDArray

from solver import Control, Design, MeshSize, ModalModel, Patches, Plant, Reduction, Run, load_design
from solver.mesh import Floats

Wiring = Literal["connected", "element", "single"]
Roots = NDArray[np.complex128]

# the seed's panel on a coarser mesh, with four elements patched and a run as short as it can be: λ_cr = 605.5
COARSE = Design(
    mesh=MeshSize(12, 4),
    patches=Patches(elements=(5, 6, 9, 10)),
    reduction=Reduction("patched", 8),
    run=Run(control_on=0.05, duration=0.3),
)


def seed(
    name: str = "seed-840",
    pressure: float | None = None,
    modes: int = 24,
    channels: Wiring = "connected",
    damping: float | None = None,
    **control: float | str | tuple[float, ...],
) -> Design:
    """A preset, changed."""
    design = load_design(name)
    design = design if pressure is None else design.with_dynamic_pressure(pressure)
    flow = design.flow if damping is None else msgspec.structs.replace(design.flow, damping=damping)
    return msgspec.structs.replace(
        design,
        flow=flow,
        patches=msgspec.structs.replace(design.patches, channels=channels),
        reduction=Reduction("patched", modes),
        control=msgspec.structs.replace(design.control, **control),
    )


@lru_cache
def whole(design: Design) -> Plant:
    """The plant in all its modes."""
    return Plant.of(design, _model(design.with_control(Control())))


@lru_cache
def plant(design: Design) -> Plant:
    """The plant in its symmetric modes, as it runs."""
    return Plant.of(design, _symmetric(design.with_control(Control())))


@lru_cache
def _model(design: Design) -> ModalModel:
    return ModalModel.of(design)


@lru_cache
def _symmetric(design: Design) -> ModalModel:
    return Plant.of(design, _model(design)).symmetric().model


def balance(of: Plant) -> Floats:
    """(2n,) what q and q̇ are multiplied by for numbers of one size, √(J): ω and 1."""
    return np.concatenate([of.model.omega, np.ones(of.size)])


def small(of: Plant, amplitude: float, random: int = 0) -> Floats:
    """(2n,) a random state of all modes with about so much of h in the first."""
    size = amplitude * of.design.panel.thickness / of.model.peak[0] * of.model.omega[0]
    return np.random.default_rng(random).standard_normal(2 * of.size) * size / balance(of)


def roots_of(matrix: Floats) -> Roots:
    """Eigenvalues."""
    return np.linalg.eigvals(matrix).astype(np.complex128)


def eigen(matrix: Floats) -> tuple[Roots, Roots]:
    """Eigenvalues and right eigenvectors."""
    values, vectors = np.linalg.eig(matrix)
    return values.astype(np.complex128), vectors.astype(np.complex128)


def system_of(a: Floats, b: Floats, c: Floats, d: Floats) -> control.StateSpace:
    """python-control's system, continuous in time."""
    system = control.ss(a, b, c, d)
    assert isinstance(system, control.StateSpace)  # ss makes other kinds from other arguments
    return system


def closed_with(of: Plant, compensator: control.StateSpace) -> Roots:
    """Poles of a plant and a compensator from charges to voltages, by python-control; the sign is the compensator's."""
    loop: Any = control.feedback(of.state_space(), compensator, sign=1)  # pyright: ignore[reportArgumentType] - its stubs say int
    return np.asarray(loop.poles(), dtype=np.complex128)
