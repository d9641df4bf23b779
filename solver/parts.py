"""Owns the parts of a Design that describe the panel and what acts on it: plies, mesh, flow, loads, patches."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from solver.atmosphere import flow_conditions
from solver.errors import DesignError
from solver.materials import Material, material

Channels = Literal["connected", "element", "single"]

MOST_PRESSURE, MOST_DAMPING = 1e5, 100.0  # λ and C_a, far beyond any panel that flies


def require(ok: bool, name: str, value: object, remedy: str) -> None:
    """Refuse a field's value, saying what would do.

    Raises:
        DesignError: it is not ok.
    """
    if not ok:
        raise DesignError(f"{name} = {value}: {remedy}")


def require_positive(owner: str, **values: float) -> None:
    """Refuse numbers of a part that are not positive, as `require`."""
    for name, value in values.items():
        require(math.isfinite(value) and 0 < value < 1e30, f"{owner}.{name}", value, "must be a positive number")


def default_of(part: type[msgspec.Struct], name: str) -> object:
    """The value that a field of a part has where none is given."""
    return next(field.default for field in msgspec.structs.fields(part) if field.name == name)


def require_poisson(name: str, value: float) -> None:
    """Refuse what is no Poisson's ratio, as `require`."""
    require(-1 < value < 0.5, name, value, "must lie between -1 and 0.5")  # NaN fails both comparisons


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a Design: immutable, and a misspelt field is an error rather than ignored."""


class Ply(Part, frozen=True):
    """One layer of a laminated skin."""

    material: str
    """Name of a material in the library, as graphite-epoxy."""
    angle_deg: float = 0.0
    """Angle of its fibres to the x axis, turning towards y [degrees]."""
    thickness: float = 0.000125
    """Thickness [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no layer."""
        material(self.material)
        require(-360 <= self.angle_deg <= 360, "ply.angle_deg", self.angle_deg, "must be an angle in degrees")
        require_positive("ply", thickness=self.thickness)


class Panel(Part, frozen=True):
    """The bare panel: a flat rectangle of one isotropic material or of plies; x runs downstream over its length."""

    length: float = 0.3048
    """Length a along the flow [m]."""
    width: float = 0.3048
    """Width b across the flow [m]."""
    thickness: float = 0.00127
    """Thickness h [m]; of plies, the sum of theirs."""
    edges: str = "ssss"
    """Edges at x = 0, x = a, y = 0, y = b, a letter each: s simply supported, c clamped, f free."""
    inplane: str = "iiii"
    """The same edges in their plane: i immovable, n held along the normal alone, s straight with no mean force, f free.

    A straight edge moves as one along its normal and, like an n, is free along itself. An edge that is free to deflect
    is free in its plane as well, whatever stands here.
    """
    young: float = 68.95e9
    """Young's modulus E [Pa]."""
    poisson: float = 0.3
    """Poisson's ratio [-]."""
    density: float = 2700.0
    """Mass density [kg/m³]."""
    expansion: float = 22.5e-6
    """Coefficient of thermal expansion α [1/K]."""
    plies: tuple[Ply, ...] = ()
    """Plies from the lower face (z < 0) up, instead of the one isotropic material."""

    def __post_init__(self) -> None:
        """Refuse what is no panel."""
        require_positive(
            "panel",
            length=self.length,
            width=self.width,
            thickness=self.thickness,
            young=self.young,
            density=self.density,
        )
        require_poisson("panel.poisson", self.poisson)
        for name, value in (("panel.length", self.length), ("panel.width", self.width)):
            require(1e-3 <= value <= 1e3, name, f"{value} m", "must be from 1 mm to 1 km")
        require(abs(self.expansion) <= 1e-2, "panel.expansion", self.expansion, "must be a strain a kelvin, as 2.3e-5")
        require(
            len(self.edges) == 4 and set(self.edges) <= set("scf"),
            "panel.edges",
            repr(self.edges),
            "use four letters s (simply supported), c (clamped) or f (free) for x = 0, x = a, y = 0, y = b, as ssss",
        )
        require(
            "c" in self.edges or self.edges.count("s") >= 2,
            "panel.edges",
            repr(self.edges),
            "the panel can move as a rigid body; clamp one edge or support two",
        )
        self._check_inplane()
        self._check_plies()

    def _check_inplane(self) -> None:
        require(
            len(self.inplane) == 4 and set(self.inplane) <= set("insf"),
            "panel.inplane",
            repr(self.inplane),
            "use four letters i (immovable), n (normal alone), s (straight) or f (free) for the four edges, as iiii",
        )
        for ends, sides in ((self.held[:2], self.held[2:]), (self.held[2:], self.held[:2])):
            require(
                not ("s" in ends and "i" in sides),
                "panel.inplane",
                repr(self.inplane),
                "a straight edge cannot move where it meets an immovable one; make the neighbours n, s or f",
            )

    def _check_plies(self) -> None:
        if not self.plies:
            return
        for name in ("young", "poisson", "density", "expansion"):
            require(
                getattr(self, name) == default_of(Panel, name),
                f"panel.{name}",
                getattr(self, name),
                "is not used where the skin is made of plies; choose their materials instead",
            )
        total = sum(ply.thickness for ply in self.plies)
        require(
            abs(total - self.thickness) <= 1e-6 * total,
            "panel.thickness",
            f"{self.thickness} m",
            f"the plies are {total:.6g} m thick together; set it to that",
        )

    @property
    def held(self) -> str:
        """How the edges are held in their plane: `inplane`, but free where an edge is free to deflect."""
        return "".join("f" if edge == "f" else kind for edge, kind in zip(self.edges, self.inplane, strict=True))


class MeshSize(Part, frozen=True):
    """The finite-element mesh: element (i, j) has id i·ny + j, i downstream and j across."""

    nx: int = 24
    """Number of elements along the flow."""
    ny: int = 6
    """Number of elements across the flow."""

    def __post_init__(self) -> None:
        """Refuse a mesh with no interior node."""
        for name, value in (("mesh.nx", self.nx), ("mesh.ny", self.ny)):
            require(value >= 2, name, value, "must be at least 2")


class Flow(Part, frozen=True):
    """The supersonic stream over the upper side, by first-order piston theory."""

    dynamic_pressure: float = 840.0
    """Nondimensional dynamic pressure λ = 2qa³/(βD) [-]."""
    damping: float = 0.01
    """Aerodynamic damping coefficient C_a [-]; g_a = √(λ C_a)."""
    yaw_deg: float = 0.0
    """Flow angle to the x axis [degrees]."""
    mach: float | None = None
    """Mach number M [-]: with it, λ and C_a follow from M and the altitude, and the two numbers above are not used."""
    altitude: float = 0.0
    """Altitude in the standard atmosphere [m], for a flow given by its Mach number."""

    def __post_init__(self) -> None:
        """Refuse a flow that is not a finite number."""
        require(
            0 <= self.dynamic_pressure <= MOST_PRESSURE,
            "flow.dynamic_pressure",
            self.dynamic_pressure,
            "must be a number from 0 to 1e5 (λ = 2qa³/(βD))",
        )
        require(0 <= self.damping <= MOST_DAMPING, "flow.damping", self.damping, "must be a number from 0 to 100 (C_a)")
        require(-360 <= self.yaw_deg <= 360, "flow.yaw_deg", self.yaw_deg, "must be an angle in degrees")
        if self.mach is not None:
            flow_conditions(self.mach, self.altitude)


class Load(Part, frozen=True):
    """What acts on the panel in its plane before it deflects: preload and heat."""

    preload_x: float = 0.0
    """Compression along x, R_x = N_x a²/(π² D11) [-]; tension is negative."""
    preload_y: float = 0.0
    """Compression along y, R_y = N_y a²/(π² D11) [-]."""
    temperature: float = 0.0
    """Uniform temperature rise ΔT over the state free of stress [K]."""
    temperature_centre: float = 0.0
    """Further rise at the centre, fading to none at the edges as 16 x(a - x) y(b - y)/(a²b²) [K]."""

    def __post_init__(self) -> None:
        """Refuse a load that is not a finite number."""
        for name in ("preload_x", "preload_y"):
            value = getattr(self, name)
            require(-1e4 <= value <= 1e4, f"load.{name}", value, "must be a number from -1e4 to 1e4 (N a²/(π² D11))")
        for name in ("temperature", "temperature_centre"):
            value = getattr(self, name)
            require(-2000 <= value <= 2000, f"load.{name}", f"{value} K", "must be from -2000 to 2000 K")


class Patches(Part, frozen=True):
    """The elements that carry a PZT layer on top and bottom, their wiring, and the ceramic."""

    elements: tuple[int, ...] = ()
    """Ids of the patched elements."""
    channels: Channels = "connected"
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
    expansion: float = 3e-6
    """Coefficient of thermal expansion of the ceramic [1/K]."""
    material: str = ""
    """Name of a piezoelectric material in the library, as pvdf, instead of the numbers above; fibres along x."""

    def __post_init__(self) -> None:
        """Sort the ids and refuse a ceramic that cannot be."""
        require_positive(
            "patches", thickness=self.thickness, young=self.young, density=self.density, max_field=self.max_field
        )
        require_poisson("patches.poisson", self.poisson)
        require(math.isfinite(self.d31), "patches.d31", self.d31, "must be a finite number [m/V]")
        require(abs(self.expansion) <= 1e-2, "patches.expansion", self.expansion, "must be a strain a kelvin, as 3e-6")
        if self.material:
            piezo = material(self.material)
            require(piezo.max_field > 0, "patches.material", self.material, "is not piezoelectric; use pzt5a, as one")
            for name in ("young", "poisson", "density", "d31", "max_field", "expansion"):
                require(
                    getattr(self, name) == default_of(Patches, name),
                    f"patches.{name}",
                    getattr(self, name),
                    f"is not used where patches.material is named ({self.material}); leave one of them out",
                )
        msgspec.structs.force_setattr(self, "elements", tuple(sorted(set(self.elements))))

    @property
    def ceramic(self) -> Material:
        """The material of the layers, by name or by the numbers given here."""
        if self.material:
            return material(self.material)
        return Material.isotropic(self.young, self.poisson, self.density, self.expansion, self.d31, self.max_field)
