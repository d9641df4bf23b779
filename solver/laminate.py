"""Owns what the layers amount to: mass and A and D stiffness of an element, bare or with its pair of PZT layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.design import Design, Panel, Patches
from solver.mesh import Floats


def plane_stress(young: float, poisson: float) -> Floats:
    """(3, 3) reduced stiffness Q of an isotropic layer in plane stress [Pa] (Jones, Mechanics of Composites, 2.61)."""
    return (
        young
        / (1 - poisson**2)
        * np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, (1.0 - poisson) / 2.0]])
    )


def flexural_rigidity(panel: Panel) -> float:
    """D11 = E h³ / (12 (1 - ν²)) of the bare panel [N·m]."""
    return panel.young * panel.thickness**3 / (12 * (1 - panel.poisson**2))


def reference_frequency(panel: Panel) -> float:
    """ω0 = √(D11 / (ρ h a⁴)) of the bare panel [rad/s], the seed's (2.9)."""
    return float(np.sqrt(flexural_rigidity(panel) / (panel.density * panel.thickness * panel.length**4)))


def moment_per_volt(panel: Panel, patches: Patches) -> float:
    """Bending moment of a pair of layers driven in opposite senses, -E_p d31 (h + h_p) / (1 - ν_p) [N/V].

    Each layer's free strain d31 V/h_p gives the force E_p d31 V/(1 - ν_p) a unit width, at ± (h + h_p)/2. The seed's
    (2.6) has it as M_0. Positive volts are those that make PZT, whose d31 is negative, give a positive moment.
    """
    return -patches.young * patches.d31 * (panel.thickness + patches.thickness) / (1 - patches.poisson)


@dataclass(frozen=True)
class Laminate:
    """Section properties of every element; the lay-up is symmetric about the mid-plane, so that B = 0."""

    mass: Floats
    """(elements,) mass a unit area [kg/m²]."""
    extension: Floats
    """(elements, 3, 3) A [N/m]."""
    bending: Floats
    """(elements, 3, 3) D [N·m]."""

    @staticmethod
    def of(design: Design) -> Laminate:
        """A, D and mass by layers (the seed's 2.7): the skin, and a layer on either side where patched."""
        panel, patches = design.panel, design.patches
        h, hp = panel.thickness, patches.thickness
        skin = plane_stress(panel.young, panel.poisson)
        ceramic = plane_stress(patches.young, patches.poisson)
        patched = np.zeros(design.mesh.nx * design.mesh.ny)
        patched[list(patches.elements)] = 1.0
        cube = ((h / 2 + hp) ** 3 - (h / 2) ** 3) * 2 / 3
        return Laminate(
            mass=panel.density * h + 2 * patches.density * hp * patched,
            extension=skin * h + (2 * hp * patched)[:, None, None] * ceramic,
            bending=skin * (h**3 / 12) + (cube * patched)[:, None, None] * ceramic,
        )
