"""Owns what the layers amount to: mass, A, B and D stiffness and thermal resultants of an element, bare or patched."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from solver.design import Design, Panel
from solver.materials import Material, material
from solver.mesh import Floats


@dataclass(frozen=True)
class Layer:
    """A layer of the skin or of a patch, at its height."""

    material: Material
    """What it is made of."""
    angle: float
    """Angle of the material's first axis to x [rad]."""
    bottom: float
    """Height of its lower face over the mid-plane of the skin [m]."""
    top: float
    """Height of its upper face [m]."""

    @property
    def thickness(self) -> float:
        """Thickness [m]."""
        return self.top - self.bottom

    @property
    def stiffness(self) -> Floats:
        """(3, 3) reduced stiffness Q̄ in the panel's axes [Pa] (Jones, Mechanics of Composite Materials, 2.85)."""
        turn = strain_rotation(self.angle)
        return turn.T @ self.material.stiffness @ turn

    @property
    def expansion(self) -> Floats:
        """(3,) free strain a kelvin in the panel's axes, (x, y, xy) [1/K]."""
        free = np.array([self.material.expansion_1, self.material.expansion_2, 0.0])
        return strain_rotation(-self.angle) @ free


def strain_rotation(angle: float) -> Floats:
    """(3, 3) matrix that takes engineering strains (x, y, xy) to axes turned by an angle [rad] from x towards y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])


@lru_cache(maxsize=16)
def skin_layers(panel: Panel) -> tuple[Layer, ...]:
    """The layers of the bare panel from z = -h/2 up; kept, because much asks for them."""
    if not panel.plies:
        skin = Material.isotropic(panel.young, panel.poisson, panel.density, panel.expansion)
        return (Layer(skin, 0.0, -panel.thickness / 2, panel.thickness / 2),)
    faces = np.concatenate([[0.0], np.cumsum([ply.thickness for ply in panel.plies])])
    faces -= faces[-1] / 2
    return tuple(
        Layer(material(ply.material), float(np.radians(ply.angle_deg)), float(low), float(high))
        for ply, low, high in zip(panel.plies, faces[:-1], faces[1:], strict=True)
    )


def patch_layers(design: Design) -> tuple[Layer, ...]:
    """The pair of layers that a patch adds, below and above the skin."""
    half, hp = design.panel.thickness / 2, design.patches.thickness
    ceramic = design.patches.ceramic
    return Layer(ceramic, 0.0, -half - hp, -half), Layer(ceramic, 0.0, half, half + hp)


def flexural_rigidity(panel: Panel) -> float:
    """D11 of the bare panel [N·m]: E h³ / (12 (1 - ν²)) of an isotropic one.

    Of a laminate, D11 with all plies turned to 0°, as panel-flutter papers on composites have it: λ then means the same
    pressure whichever way the plies lie (Abdel-Motagaly, Chen and Mei, AIAA J. 37, 1999).
    """
    return float(sum(lay.material.stiffness[0, 0] * (lay.top**3 - lay.bottom**3) / 3 for lay in skin_layers(panel)))


def areal_mass(panel: Panel) -> float:
    """ρh of the bare panel [kg/m²]."""
    return sum(lay.material.density * lay.thickness for lay in skin_layers(panel))


def reference_frequency(panel: Panel) -> float:
    """ω0 = √(D11 / (ρ h a⁴)) of the bare panel [rad/s], the seed's (2.9)."""
    return float(np.sqrt(flexural_rigidity(panel) / (areal_mass(panel) * panel.length**4)))


def moment_per_volt(design: Design) -> Floats:
    """(3,) bending moments (x, y, xy) of a pair of layers driven in opposite senses [N/V].

    Each layer's free strain d V/h_p gives the force -Q_p d V a unit width, at ± (h + h_p)/2; with d31 = d32 that is
    -E_p d31 (h + h_p) / (1 - ν_p), the seed's (2.6). Positive volts are those that make PZT, whose d31 is negative,
    give a positive moment.
    """
    ceramic = design.patches.ceramic
    free = np.array([ceramic.d31, ceramic.d32, 0.0])
    return -ceramic.stiffness @ free * (design.panel.thickness + design.patches.thickness)


@dataclass(frozen=True)
class Laminate:
    """Section properties of every element about the mid-plane of the skin."""

    mass: Floats
    """(elements,) mass a unit area [kg/m²]."""
    extension: Floats
    """(elements, 3, 3) A [N/m]."""
    coupling: Floats
    """(elements, 3, 3) B [N], zero for a lay-up symmetric about the mid-plane."""
    bending: Floats
    """(elements, 3, 3) D [N·m]."""
    thermal_force: Floats
    """(elements, 3) N_T, force a unit width and kelvin that would hold all expansion back [N/(m·K)]."""
    thermal_moment: Floats
    """(elements, 3) M_T, moment a unit width and kelvin likewise [N/K]."""

    @staticmethod
    def of(design: Design) -> Laminate:
        """Section properties by layers (the seed's 2.7): the skin, and a layer on either side where patched."""
        patched = np.zeros(design.mesh.nx * design.mesh.ny)
        patched[list(design.patches.elements)] = 1.0
        skin, pair = _resultants(skin_layers(design.panel)), _resultants(patch_layers(design))
        mass, extension, coupling, bending, force, moment = (
            one + np.multiply.outer(patched, two) for one, two in zip(skin, pair, strict=True)
        )
        return Laminate(mass, extension, coupling, bending, force, moment)

    @property
    def symmetric(self) -> bool:
        """Whether B is zero (but for rounding) in every element."""
        # of Q h²/2, what a single layer at the surface would give
        scale = np.abs(self.extension).max() * np.sqrt(np.abs(self.bending).max() / np.abs(self.extension).max())
        return bool(np.abs(self.coupling).max() <= 1e-9 * scale)

    @property
    def warps(self) -> bool:
        """Whether heat bends it: B is not zero, or the upper and the lower half expand by different forces."""
        height = np.sqrt(np.abs(self.bending).max() / np.abs(self.extension).max())
        free = np.abs(self.thermal_moment).max() <= 1e-9 * height * np.abs(self.thermal_force).max()
        return not (self.symmetric and free)

    @property
    def mirrored(self) -> bool:
        """Whether every element is alike in y and -y: no coupling of shear or twist with anything else."""
        for force, scale in ((self.thermal_force, 1.0), (self.thermal_moment, np.abs(self.thermal_force).max())):
            if np.abs(force[:, 2]).max() > 1e-9 * max(np.abs(force).max(), 1e-9 * scale):
                return False
        kept = (self.extension, self.bending) if self.symmetric else (self.extension, self.bending, self.coupling)
        return all(np.abs(m[:, :2, 2]).max() <= 1e-9 * np.abs(m).max() for m in kept)


def _resultants(layers: tuple[Layer, ...]) -> tuple[Floats, ...]:
    """Mass a unit area, A, B, D, N_T and M_T of a stack of layers (Jones 4.24 and 4.79)."""
    faces = np.array([(lay.bottom, lay.top) for lay in layers])
    order = np.array([1, 2, 3])
    moments = np.diff(faces[..., None] ** order, axis=1)[:, 0].T / order[:, None]  # ∫ 1, z, z² dz, each of every layer
    stiffness = np.array([lay.stiffness for lay in layers])
    heated = np.array([lay.stiffness @ lay.expansion for lay in layers])
    mass = np.dot(moments[0], [lay.material.density for lay in layers])
    extension, coupling, bending = np.einsum("kl,lab->kab", moments, stiffness)
    return mass, extension, coupling, bending, *np.einsum("kl,la->ka", moments[:2], heated)
