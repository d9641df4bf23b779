"""The air at an altitude: the standard's own table, and one-line answers to what lies outside it."""

import math
import subprocess
import sys
from itertools import pairwise

import pytest

from solver.atmosphere import flow_conditions, piston_warnings
from solver.errors import DesignError


@pytest.mark.parametrize(
    ("altitude", "density", "sound"),
    [
        (0.0, 1.2250, 340.294),
        (5000.0, 0.73643, 320.545),
        (11000.0, 0.36480, 295.154),
        (11019.0, 0.36392, 295.069),  # the tropopause, 11 km geopotential
        (20000.0, 0.088910, 295.069),
        (30000.0, 0.018410, 301.709),
    ],
)
def test_standard_atmosphere(altitude: float, density: float, sound: float) -> None:
    """ICAO standard atmosphere (Doc 7488; US 1976 agrees up to 32 km) at geometric altitudes, to its five digits."""
    air = flow_conditions(2.0, altitude)
    assert air.density == pytest.approx(density, rel=1e-4)
    assert air.speed_of_sound == pytest.approx(sound, rel=1e-5)


@pytest.mark.parametrize("mach", [1.01, 1.5, 2.0, 5.0])
@pytest.mark.parametrize("altitude", [-1000.0, 0.0, 15000.0, 40000.0])
def test_dynamic_pressure_is_also_that_of_the_gas_law(mach: float, altitude: float) -> None:
    """q = ρV²/2 = γ p M²/2, and a² = γ p/ρ; so q/M² = ρ a²/2 does not depend on M."""
    air = flow_conditions(mach, altitude)
    assert air.velocity == pytest.approx(mach * air.speed_of_sound, rel=1e-14)
    assert air.dynamic_pressure_pa == pytest.approx(0.5 * air.density * air.velocity**2, rel=1e-14)
    still = air.density * air.speed_of_sound**2 / 2
    assert air.dynamic_pressure_pa / mach**2 == pytest.approx(still, rel=1e-13)


def test_dynamic_pressure_at_sea_level() -> None:
    """γ p M²/2 = 0.7 · 101325 · 4 Pa."""
    assert flow_conditions(2.0, 0.0).dynamic_pressure_pa == pytest.approx(0.7 * 101325 * 4, rel=1e-5)


def test_air_thins_with_altitude() -> None:
    densities = [flow_conditions(2.0, h).density for h in range(-5000, 81000, 1000)]
    assert all(upper < lower for lower, upper in pairwise(densities))


@pytest.mark.parametrize("mach", [1.0, 0.8, 0.0, -2.0, math.nan, math.inf, -math.inf, 1e200])
def test_flow_that_is_not_supersonic_is_refused(mach: float) -> None:
    with pytest.raises(DesignError, match=r"flow\.mach = .*above 1") as caught:
        flow_conditions(mach, 0.0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("altitude", [-5005.0, 81021.0, 1e9, math.nan, math.inf, -math.inf])
def test_altitude_outside_the_standard_is_refused_with_its_range(altitude: float) -> None:
    with pytest.raises(DesignError, match=r"flow\.altitude = .*from -5004 to 81020 m") as caught:
        flow_conditions(2.0, altitude)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("altitude", [-5004.0, 81020.0, 0])
def test_the_ends_of_the_range_are_in_it(altitude: float) -> None:
    assert flow_conditions(2.0, altitude).density > 0


@pytest.mark.parametrize(
    ("mach", "told"),
    [
        (1.2, "needs M > √2"),
        (math.sqrt(2), "needs M > √2"),
        (1.42, "in practice from M = 1.6 to 5"),
        (1.59, "in practice from M = 1.6 to 5"),
        (5.01, "in practice from M = 1.6 to 5"),
        (8.0, "in practice from M = 1.6 to 5"),
    ],
)
def test_warning_names_the_mach_number_and_the_limit(mach: float, told: str) -> None:
    warnings = piston_warnings(mach)
    assert len(warnings) == 1
    assert told in warnings[0]
    assert f"M = {mach:g}" in warnings[0]
    assert "\n" not in warnings[0]


@pytest.mark.parametrize("mach", [1.6, 2.0, 3.5, 5.0])
def test_no_warning_where_the_theory_is_used(mach: float) -> None:
    assert piston_warnings(mach) == []


def test_library_is_imported_only_when_asked() -> None:
    """In a process of its own: this one has imported it already."""
    code = "import sys, solver.atmosphere; print('ambiance' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
