"""Owns the air at an altitude: density, speed of sound and dynamic pressure of a flight, and where the theory holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from solver.errors import DesignError

MAX_MACH = 100  # far beyond flight in air: it only keeps the numbers finite


@dataclass(frozen=True)
class Conditions:
    """The stream that a flight at some Mach number and altitude meets."""

    density: float
    """Mass density of the air ρ_a [kg/m³]."""
    speed_of_sound: float
    """Speed of sound [m/s]."""
    velocity: float
    """Speed of the stream V [m/s]."""
    dynamic_pressure_pa: float
    """Dynamic pressure q = ρ_a V²/2 [Pa]; not the nondimensional λ."""


@lru_cache(maxsize=256)
def flow_conditions(mach: float, altitude: float) -> Conditions:
    """The stream at a Mach number [-] and a geometric altitude [m] in the ICAO standard atmosphere (Doc 7488, 1993).

    Raises:
        DesignError: the flow is not supersonic, or the standard atmosphere does not reach that altitude.
    """
    if not 1 < mach <= MAX_MACH:  # NaN fails both comparisons
        raise DesignError(
            f"flow.mach = {mach}: must be above 1 and at most {MAX_MACH}; the theory is for supersonic flow"
        )

    from ambiance import CONST, Atmosphere  # here, because few runs need it

    if not CONST.h_min <= altitude <= CONST.h_max:  # NaN fails both comparisons
        raise DesignError(
            f"flow.altitude = {altitude} m: must be from {CONST.h_min} to {CONST.h_max} m, as the standard atmosphere"
        )
    air = Atmosphere(float(altitude))
    density, sound = float(air.density[0]), float(air.speed_of_sound[0])
    velocity = mach * sound
    return Conditions(density, sound, velocity, density * velocity**2 / 2)


def piston_warnings(mach: float) -> list[str]:
    """What to mind about first-order piston theory at a Mach number [-], a line each; nothing from M = 1.6 to 5.

    The term in w,t carries (M² - 2)/(M² - 1), which vanishes at M = √2 and would drive the panel below (Dowell,
    Aeroelasticity of Plates and Shells, 1975). Far above, the terms that are not linear in w,x are no longer small.
    """
    if mach <= math.sqrt(2):
        return [f"first-order piston theory does not hold at M = {mach:g}: needs M > √2"]
    if mach < 1.6 or mach > 5:
        return [f"first-order piston theory is doubtful at M = {mach:g}: it is used in practice from M = 1.6 to 5"]
    return []
