"""Owns first-order piston theory: what the flow adds to stiffness and damping, per unit and at a dynamic pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from solver.atmosphere import flow_conditions, piston_warnings
from solver.design import Design
from solver.errors import DesignError
from solver.laminate import areal_mass, flexural_rigidity, reference_frequency
from solver.parts import MOST_DAMPING, MOST_PRESSURE, Flow, default_of

ROUNDING = 1e-12  # of a sine


@dataclass(frozen=True)
class Stream:
    """p = -(λ D11/a³ (w,x cosΛ + w,y sinΛ) + (g_a/ω0) D11/a⁴ w,t), the seed's (2.8), with yaw.

    D11, ρ, h and ω0 are the bare panel's, whether it carries patches or not.
    """

    dynamic_pressure: float
    """Nondimensional dynamic pressure λ = 2qa³/(βD11) [-]."""
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
    notes: tuple[str, ...] = ()
    """What is to be said of the theory at this Mach number, a line each."""

    @staticmethod
    def of(design: Design) -> Stream:
        """The stream of a design: λ and C_a as given, or from Mach number and altitude.

        With q = ρ_a V²/2, β = √(M² - 1) and μ = ρ_a a/(ρ h): λ = 2qa³/(βD11), C_a = ((M² - 2)/(M² - 1))² μ/β (the
        seed's 2.9).
        """
        panel, flow, yaw = design.panel, design.flow, math.radians(design.flow.yaw_deg)
        rigidity, mass = flexural_rigidity(panel), areal_mass(panel)
        pressure, damping, notes = flow.dynamic_pressure, flow.damping, ()
        if flow.mach is not None:
            air, beta = flow_conditions(flow.mach, flow.altitude), math.sqrt(flow.mach**2 - 1)
            pressure = 2 * air.dynamic_pressure_pa * panel.length**3 / (beta * rigidity)
            damping = ((flow.mach**2 - 2) / beta**2) ** 2 * air.density * panel.length / (mass * beta)
            unused = [name for name in ("dynamic_pressure", "damping") if getattr(flow, name) != default_of(Flow, name)]
            notes = tuple(f"flow.{name} is not used: flow.mach gives λ and C_a" for name in unused)
            notes += tuple(piston_warnings(flow.mach))
            if not (pressure <= MOST_PRESSURE and damping <= MOST_DAMPING):
                raise DesignError(
                    f"flow.mach = {flow.mach:g}: gives λ = {pressure:.4g} and C_a = {damping:.4g}, beyond "
                    f"{MOST_PRESSURE:g} and {MOST_DAMPING:g}; use a higher Mach number or altitude, or a stiffer panel"
                )
        return Stream(
            dynamic_pressure=pressure,
            slope_unit=rigidity / panel.length**3,
            rate_unit=reference_frequency(panel) * mass,
            damping=damping,
            cosine=_clean(math.cos(yaw)),
            sine=_clean(math.sin(yaw)),
            notes=notes,
        )

    def rate(self, dynamic_pressure: float) -> float:
        """Pressure a unit rate [Pa·s/m] at λ, with g_a = √(λ C_a) (the seed's 2.9)."""
        return self.rate_unit * math.sqrt(dynamic_pressure * self.damping)


def _clean(value: float) -> float:
    """A sine or cosine whose rounding is taken off at right angles: the symmetry of a panel hangs on an exact 0."""
    return value if abs(value) > ROUNDING else 0.0


def design_at_pressure(design: Design, dynamic_pressure: float) -> Design:
    """The design at another λ [-]; one that was given by its Mach number keeps the C_a which that gave it."""
    if design.flow.mach is None:
        return design.with_dynamic_pressure(dynamic_pressure)
    flow = msgspec.structs.replace(
        design.flow, dynamic_pressure=dynamic_pressure, damping=Stream.of(design).damping, mach=None
    )
    return msgspec.structs.replace(design, flow=flow)
