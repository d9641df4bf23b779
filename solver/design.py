"""Owns the Design: all that a user chooses about a panel, its flow, patches, control and run, and nothing derived."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from solver.errors import DesignError

SCHEMA_VERSION = 1
MAX_ELEMENTS = 10_000  # a 100 x 100 mesh; dense modal matrices beyond it no longer fit the memory of a laptop


def _check(ok: bool, name: str, value: object, remedy: str) -> None:
    if not ok:
        raise DesignError(f"{name} = {value}: {remedy}")


def _positive(owner: str, **values: float) -> None:
    for name, value in values.items():
        _check(math.isfinite(value) and 0 < value < 1e30, f"{owner}.{name}", value, "must be a positive number")


def _poisson(name: str, value: float) -> None:
    _check(-1 < value < 0.5, name, value, "must lie between -1 and 0.5")  # NaN fails both comparisons


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a Design: immutable, and a misspelt field is an error rather than ignored."""


class Panel(_Part, frozen=True):
    """The bare panel: a flat rectangle of one isotropic material; x runs downstream over its length."""

    length: float = 0.3048
    """Length a along the flow [m]."""
    width: float = 0.3048
    """Width b across the flow [m]."""
    thickness: float = 0.00127
    """Thickness h [m]."""
    edges: str = "ssss"
    """Edges at x = 0, x = a, y = 0, y = b, a letter each: s simply supported, c clamped; in-plane all are immovable."""
    young: float = 68.95e9
    """Young's modulus E [Pa]."""
    poisson: float = 0.3
    """Poisson's ratio [-]."""
    density: float = 2700.0
    """Mass density [kg/m³]."""

    def __post_init__(self) -> None:
        """Refuse what is no panel."""
        _positive(
            "panel",
            length=self.length,
            width=self.width,
            thickness=self.thickness,
            young=self.young,
            density=self.density,
        )
        _poisson("panel.poisson", self.poisson)
        for name, value in (("panel.length", self.length), ("panel.width", self.width)):
            _check(1e-3 <= value <= 1e3, name, f"{value} m", "must be from 1 mm to 1 km")
        _check(
            len(self.edges) == 4 and set(self.edges) <= set("sc"),
            "panel.edges",
            repr(self.edges),
            "use four letters s (simply supported) or c (clamped) for x = 0, x = a, y = 0, y = b, as ssss",
        )


class MeshSize(_Part, frozen=True):
    """The finite-element mesh: element (i, j) has id i·ny + j, i downstream and j across."""

    nx: int = 24
    """Number of elements along the flow."""
    ny: int = 6
    """Number of elements across the flow."""

    def __post_init__(self) -> None:
        """Refuse a mesh with no interior node."""
        for name, value in (("mesh.nx", self.nx), ("mesh.ny", self.ny)):
            _check(value >= 2, name, value, "must be at least 2")


class Flow(_Part, frozen=True):
    """The supersonic stream over the upper side, by first-order piston theory."""

    dynamic_pressure: float = 840.0
    """Nondimensional dynamic pressure λ = 2qa³/(βD) [-]."""
    damping: float = 0.01
    """Aerodynamic damping coefficient C_a [-]; g_a = √(λ C_a)."""
    yaw_deg: float = 0.0
    """Flow angle to the x axis [degrees]."""

    def __post_init__(self) -> None:
        """Refuse a flow that is not a finite number."""
        _check(
            0 <= self.dynamic_pressure <= 1e5,
            "flow.dynamic_pressure",
            self.dynamic_pressure,
            "must be a number from 0 to 1e5 (λ = 2qa³/(βD))",
        )
        _check(0 <= self.damping <= 100, "flow.damping", self.damping, "must be a number from 0 to 100 (C_a)")
        _check(-360 <= self.yaw_deg <= 360, "flow.yaw_deg", self.yaw_deg, "must be an angle in degrees")


class Patches(_Part, frozen=True):
    """The elements that carry a PZT layer on top and bottom, their wiring, and the ceramic."""

    elements: tuple[int, ...] = ()
    """Ids of the patched elements."""
    channels: Literal["connected", "element", "single"] = "connected"
    """Which patches share a voltage: each edge-connected group, each element alone, or all."""
    thickness: float = 0.000381
    """Thickness h_p of one layer [m]."""
    young: float = 62e9
    """Young's modulus of the ceramic [Pa]."""
    poisson: float = 0.3
    """Poisson's ratio of the ceramic [-]."""
    density: float = 7593.0
    """Mass density of the ceramic [kg/m³]."""
    d31: float = -1.91e-10
    """Piezoelectric charge constant d31 [m/V]."""
    max_field: float = 600e3
    """Coercive field E_max, beyond which the ceramic loses its poling [V/m]."""

    def __post_init__(self) -> None:
        """Sort the ids and refuse a ceramic that cannot be."""
        _positive("patches", thickness=self.thickness, young=self.young, density=self.density, max_field=self.max_field)
        _poisson("patches.poisson", self.poisson)
        _check(math.isfinite(self.d31), "patches.d31", self.d31, "must be a finite number [m/V]")
        msgspec.structs.force_setattr(self, "elements", tuple(sorted(set(self.elements))))


class Control(_Part, frozen=True):
    """The regulator that drives the patches."""

    kind: Literal["lqr", "off"] = "lqr"
    """lqr: linear quadratic regulator about the flat panel; off: no control."""
    state_weight: float = 1e6
    """Weight s on twice the mechanical energy, Q = s·blockdiag(K, M) [V²/J]."""
    effort_weight: float = 10.0
    """Weight R on the squared voltage of each channel [-]."""
    voltage_limit: float = 228.6
    """Largest voltage the drive gives [V]."""

    def __post_init__(self) -> None:
        """Refuse weights for which no regulator exists."""
        _positive(
            "control",
            state_weight=self.state_weight,
            effort_weight=self.effort_weight,
            voltage_limit=self.voltage_limit,
        )
        ratio = self.state_weight / self.effort_weight
        _check(
            1e-6 <= ratio <= 1e12,
            "control.state_weight / control.effort_weight",
            f"{ratio:g}",
            "must be from 1e-6 to 1e12: beyond it the Riccati equation cannot be solved in doubles",
        )


class Reduction(_Part, frozen=True):
    """The modal basis that the motion is described in."""

    basis: Literal["patched", "family"] = "patched"
    """patched: lowest modes of the panel with its patches on; family: the (m,1) shapes m = 1, 2, …."""
    modes: int | Literal["all"] = 24
    """How many modes; all (every one the mesh has) is for λ_cr alone."""

    def __post_init__(self) -> None:
        """Refuse a basis too small to flutter (two modes must meet) or too large for its cubic law."""
        if self.modes != "all":
            _check(2 <= self.modes <= 120, "reduction.modes", self.modes, "must be from 2 to 120, or all")


class Run(_Part, frozen=True):
    """The seed protocol: start in the first mode, flutter freely, then switch the controller on."""

    initial_amplitude: float = 0.1
    """Largest |w| at the start, in the first mode at rest, over the thickness h [-]."""
    control_on: float = 0.2
    """Instant t_on at which the controller is switched on [s]."""
    duration: float = 0.8
    """Length of the run [s]."""
    settled: float = 0.0005
    """The panel counts as damped once its largest |w| over h stays below this [-]."""

    def __post_init__(self) -> None:
        """Refuse a run that has no beginning or no end."""
        _positive("run", initial_amplitude=self.initial_amplitude, duration=self.duration, settled=self.settled)
        _check(self.initial_amplitude <= 10, "run.initial_amplitude", self.initial_amplitude, "must be at most 10 (h)")
        _check(
            1e-3 <= self.duration <= 60, "run.duration", self.duration, "must be from 0.001 to 60 s of simulated time"
        )
        _check(self.control_on >= 0, "run.control_on", self.control_on, "must be a time from 0 on [s]")


class Design(_Part, frozen=True):
    """All that a user chose; everything else in `solver` is a function of it. SI units throughout."""

    schema_version: int = SCHEMA_VERSION
    """Version of this file format."""
    panel: Panel = Panel()
    """The bare panel."""
    mesh: MeshSize = MeshSize()
    """The finite-element mesh."""
    flow: Flow = Flow()
    """The stream."""
    patches: Patches = Patches()
    """The patches and their wiring."""
    control: Control = Control()
    """The regulator."""
    reduction: Reduction = Reduction()
    """The modal basis."""
    run: Run = Run()
    """The run in time."""

    def __post_init__(self) -> None:
        """Check what depends on more than one field; each alone was checked by its part."""
        _check(
            self.schema_version == SCHEMA_VERSION,
            "schema_version",
            self.schema_version,
            f"this version of flutterviz reads {SCHEMA_VERSION}",
        )
        panel, count = self.panel, self.mesh.nx * self.mesh.ny
        _check(
            panel.thickness <= 0.1 * min(panel.length, panel.width),
            "panel.thickness",
            f"{panel.thickness} m",
            "a thin plate is at most a tenth of its shorter side; use a smaller thickness",
        )
        _check(count <= MAX_ELEMENTS, "mesh.nx * mesh.ny", count, f"must be at most {MAX_ELEMENTS} elements")
        _check(
            self.run.control_on <= self.run.duration,
            "run.control_on",
            f"{self.run.control_on} s",
            f"must lie within the run, 0 to run.duration = {self.run.duration} s",
        )
        for e in self.patches.elements:
            _check(
                0 <= e < count,
                "patches.elements",
                e,
                f"the {self.mesh.nx} x {self.mesh.ny} mesh has elements 0 to {count - 1}",
            )
        coercive = self.patches.max_field * self.patches.thickness
        _check(
            self.control.voltage_limit <= coercive * (1 + 1e-9),
            "control.voltage_limit",
            f"{self.control.voltage_limit} V",
            f"the ceramic loses its poling beyond patches.max_field x patches.thickness = {coercive:.4g} V",
        )

    def with_elements(self, elements: tuple[int, ...]) -> Design:
        """The same design with another set of patched elements."""
        return msgspec.structs.replace(self, patches=msgspec.structs.replace(self.patches, elements=elements))

    def with_dynamic_pressure(self, value: float) -> Design:
        """The same design at another dynamic pressure λ [-]."""
        return msgspec.structs.replace(self, flow=msgspec.structs.replace(self.flow, dynamic_pressure=value))

    def with_reduction(self, basis: Literal["patched", "family"], modes: int | Literal["all"]) -> Design:
        """The same design in another modal basis."""
        return msgspec.structs.replace(self, reduction=Reduction(basis, modes))
