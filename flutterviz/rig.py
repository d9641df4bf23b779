"""Owns the rig: all that running and showing a design takes, built anywhere and swapped in whole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from flutterviz.surface import DisplayGrid
from solver import ControlError, Design, Law, Loop, Plant
from solver.holding import shortfall
from solver.simulate import SAMPLES_A_PERIOD, first_mode_at_rest
from solver.trace import probe_shapes

Floats = NDArray[np.floating]

SETTLING_PERIODS = 50  # of motion computed before the page opens: the panel is then in full flutter


@dataclass(frozen=True)
class Rig:
    """A design's plant and regulator, with its mode shapes sampled for display."""

    design: Design
    """What it was built from."""
    loop: Loop
    """Plant and regulator, laid out for the kernel."""
    grid: DisplayGrid
    """Where the surface is sampled."""
    surface: Floats
    """(nvx·nvy, n) mode shapes on the display grid [1/√kg]."""
    coarse: Floats
    """(points, n) mode shapes where the largest |w| is looked for [1/√kg]."""
    probe: Floats
    """(n,) mode shapes at the 0.75 a point [1/√kg]."""
    bare_critical: float | None
    """λ_cr of the panel without patches [-], to tell a passive layout from a flow in which nothing flutters."""
    refusal: str | None
    """Why there is no controller for these patches, if there is none."""
    shortfall: str
    """Why the controller does not make the flat panel stable, or why there is none; empty where it does."""

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self.loop.plant

    @property
    def thickness(self) -> float:
        """Panel thickness h [m]."""
        return self.design.panel.thickness

    @property
    def complete(self) -> bool:
        """Whether λ_cr is known; if not, who asks the plant for it waits as long as for a good part of the rig."""
        return "critical" in vars(self.plant)

    def complete_with(self, critical: tuple[float, float] | None) -> None:
        """Take the plant's `critical` from who has computed it elsewhere."""
        vars(self.plant)["critical"] = critical

    def displacement(self, state: Floats) -> Floats:
        """(nvx, nvy) w on the display grid [m] at a state (2n,)."""
        return (self.surface @ state[: self.plant.size]).reshape(self.grid.shape)


def rig_of(design: Design, last: Rig | None = None, complete: bool = True) -> Rig:
    """Build the rig of a design, using again what a change of flow or control leaves as it is.

    Args:
        design: the design.
        last: a rig before.
        complete: with λ_cr, which takes long and which nothing that moves depends on.

    Raises:
        DesignError: the design cannot be simulated, as with all modes retained.
    """
    same = last is not None and same_structure(design, last.design)
    plant = Plant.of(design, last.plant.model if last is not None and same else None)
    refusal = None
    try:
        loop = Loop.of(plant)
    except ControlError as error:
        refusal = str(error)
        loop = Loop.of(plant, Law.idle(plant))
    _ = plant.model.membrane, plant.growth, loop.poles, loop.growth  # computed here, where waiting does no harm
    if complete:
        _ = plant.critical
    grid = DisplayGrid(design.panel.length, design.panel.width, design.mesh.nx, design.mesh.ny)
    keep = last if same else None
    return Rig(
        design=design,
        loop=loop,
        grid=grid,
        surface=keep.surface if keep else plant.model.sampled(grid.per_x, grid.per_y).reshape(-1, plant.size),
        coarse=keep.coarse if keep else plant.model.coarse,
        probe=keep.probe if keep else probe_shapes(plant),
        bare_critical=_bare_critical(_bare(design)),
        refusal=refusal,
        shortfall=refusal or (shortfall(loop) if loop.law.asks or not plant.channels else ""),
    )


def same_structure(design: Design, other: Design) -> bool:
    """Whether two designs have their modes in common."""
    return _structure(design) == _structure(other)


def same_panel(design: Design, other: Design) -> bool:
    """Whether the motion of one can go on in the other: on the same mesh of the same panel."""
    return (design.panel, design.mesh) == (other.panel, other.mesh)


def _structure(design: Design) -> tuple[object, ...]:
    """What the modal model depends on: not the flow, unless its eigenvectors are the basis."""
    flow = design.flow if design.reduction.basis == "aeroelastic" else None
    patches = msgspec.structs.replace(design.patches, channels="connected")  # wiring is no matter of modes
    return design.panel, design.mesh, design.load, patches, design.reduction, flow


def _bare(design: Design) -> Design:
    """The design without patches and, where λ is a number of its own, at none: one answer serves every λ."""
    bare = design.with_elements(())
    if bare.reduction.basis == "aeroelastic":  # a basis that changes with λ
        bare = bare.with_reduction("patched", bare.reduction.modes)
    return bare if bare.flow.mach is not None else bare.with_dynamic_pressure(0.0)


@lru_cache(maxsize=8)
def _bare_critical(design: Design) -> float | None:
    found = Plant.of(design).critical
    return found[0] if found else None


def in_flutter(rig: Rig) -> Floats:
    """(2n,) state after a small start and a while left to itself: on the limit cycle, if there is one."""
    start = first_mode_at_rest(rig.plant, rig.design.run.initial_amplitude * rig.thickness)
    if not rig.plant.flutters:
        return start
    sample = rig.plant.period / SAMPLES_A_PERIOD
    states, _ = rig.loop.stretch(start, sample, SETTLING_PERIODS * SAMPLES_A_PERIOD, engaged=False)
    return states[-1].copy() if len(states) else start
