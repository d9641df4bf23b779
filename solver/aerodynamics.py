"""Owns first-order piston theory: what the flow adds to stiffness and damping, per unit and at a dynamic pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from solver.design import Design
from solver.laminate import flexural_rigidity, reference_frequency


@dataclass(frozen=True)
class Stream:
    """p = -(λ D11/a³ (w,x cosΛ + w,y sinΛ) + (g_a/ω0) D11/a⁴ w,t), the seed's (2.8), with yaw.

    D11, ρ, h and ω0 are the bare panel's, whether it carries patches or not.
    """

    slope_unit: float
    """D11/a³: pressure a unit slope and a unit λ [Pa]."""
    rate_unit: float
    """ω0 ρ h = D11/(ω0 a⁴): pressure a unit rate and a unit g_a [Pa·s/m]."""
    damping: float
    """Aerodynamic damping coefficient C_a [-]."""
    cosine: float
    """cos Λ of the yaw angle."""
    sine: float
    """sin Λ of the yaw angle."""

    @staticmethod
    def of(design: Design) -> Stream:
        """The stream of a design."""
        panel, yaw = design.panel, math.radians(design.flow.yaw_deg)
        return Stream(
            slope_unit=flexural_rigidity(panel) / panel.length**3,
            rate_unit=reference_frequency(panel) * panel.density * panel.thickness,
            damping=design.flow.damping,
            cosine=math.cos(yaw),
            sine=math.sin(yaw),
        )

    def rate(self, dynamic_pressure: float) -> float:
        """Pressure a unit rate [Pa·s/m] at λ, with g_a = √(λ C_a) (the seed's 2.9)."""
        return self.rate_unit * math.sqrt(dynamic_pressure * self.damping)
