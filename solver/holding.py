"""Owns how far in dynamic pressure a controller holds the panel: stable for small motions, quiet under its limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from solver.controllers import law_of
from solver.design import Design
from solver.errors import ControlError
from solver.flutter import GROWTH_NOISE
from solver.limitcycle import LimitCycle, limit_cycle
from solver.plant import Plant
from solver.reach import out_of_reach
from solver.robust import RobustDamping, robust_damping, suppresses
from solver.simulate import Loop, loop_if_any, seed_protocol

BELOW = (0.0, 0.25, 0.5, 0.75, 1.0)  # of λ_cr, where a controller is looked at for harm that it does
MOST = 4.0  # times λ_cr up to which a controller is followed
STEP = 1.04  # from one trial λ to the next: windows narrower than that are not looked for
STEP_NONLINEAR = 1.12
RESOLUTION, RESOLUTION_NONLINEAR = 1e-3, 5e-3  # relative


@dataclass(frozen=True)
class Hold:
    """How far a controller holds the panel, made anew for every λ."""

    dynamic_pressure: float
    """The largest λ up to which it does without a gap [-]; 0 if not even below λ_cr, where it need but do no harm."""
    open_ended: bool
    """Whether it still does there, and no further was looked."""
    reason: str
    """What is beyond it, in words; empty if open-ended."""


def stabilises_up_to(plant: Plant) -> Hold | None:
    """The largest λ up to which the design's controller makes the flat panel stable for small motions.

    Args:
        plant: the panel in all its modes: what nothing excites and nothing reaches counts here.

    Returns:
        The λ; None where the panel does not flutter at any, or nothing is to drive it.
    """
    if plant.critical is None or not plant.channels or plant.design.control.kind == "off":
        return None
    start = plant.critical[0]
    for share in BELOW:
        lower = plant.at_pressure(share * start)
        if not _stable(lower):
            return Hold(0.0, False, f"already at λ = {share * start:.4g}, {_why(lower)}")
    found = _last(lambda value: _stable(plant.at_pressure(value)), start, MOST * start, STEP, RESOLUTION)
    if found is None:
        return Hold(MOST * start, True, "")
    return Hold(found, False, _why(plant.at_pressure(found * (1 + 2 * RESOLUTION))))


def suppresses_up_to(whole: Plant, linear: Hold | None) -> Hold | None:
    """The largest λ up to which the design's controller ends the limit cycle, from any of 8 phases, in the run's time.

    Bisection on the nonlinear run of the seed protocol, the voltage limit included; no further than small motions are
    stable, those too that the protocol's start does not excite.

    Args:
        whole: the panel in all its modes.
        linear: what `stabilises_up_to` found for it.

    Returns:
        The λ; None where the panel does not flutter at any, nothing drives it, or the run has no time for it.
    """
    run = whole.design.run
    if whole.critical is None or linear is None or run.duration <= run.control_on:
        return None
    if linear.dynamic_pressure <= whole.critical[0]:
        return linear
    plant, start = whole.symmetric(), whole.critical[0]
    last: list[LimitCycle] = []

    def quiet(value: float) -> bool:
        loop = loop_if_any(plant.at_pressure(value))
        if loop is None or not loop.plant.flutters:
            return loop is not None
        cycle = limit_cycle(loop, last[-1].state if last else None)
        last[:] = [cycle] if cycle else []
        return suppresses(loop, cycle)

    found = _last(quiet, start, linear.dynamic_pressure, STEP_NONLINEAR, RESOLUTION_NONLINEAR)
    if found is None:
        return linear
    return Hold(found, False, "from some phase the limit cycle outlasts the controller's time in the run")


def _last(holds: Callable[[float], bool], start: float, end: float, step: float, resolution: float) -> float | None:
    """Largest value from a start on up to which a property holds; the start if none; None if up to the end."""
    low = start
    while low < end:
        high = min(low * step, end)
        if not holds(high):
            while high / low > 1 + resolution:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if holds(middle) else (low, middle)
            return low
        low = high
    return None


def stable(loop: Loop) -> bool:
    """Whether nothing grows about the flat panel by more than rounding."""
    return loop.growth.real <= GROWTH_NOISE * float(loop.plant.model.omega[0])


def _stable(plant: Plant) -> bool:
    loop = loop_if_any(plant)
    return loop is not None and stable(loop)


def shortfall(loop: Loop) -> str:
    """Why a loop about the flat panel is not stable, in a line; empty where it is."""
    plant, growth = loop.plant, loop.growth
    if stable(loop):
        return ""
    if not loop.law.asks:
        return f"nothing is driven, and the flat panel's motion grows at {growth.real:+.1f} /s"
    missed = out_of_reach(plant)
    hertz = growth.imag / (2 * np.pi)
    return missed[0] if missed else f"under control a motion still grows, at {growth.real:+.1f} /s and {hertz:.1f} Hz"


def _why(plant: Plant) -> str:
    """Why the design's controller does not make a plant stable."""
    try:
        return shortfall(Loop.of(plant))
    except ControlError as error:
        return str(error)


@dataclass(frozen=True)
class HoldRow:
    """A layout at one λ."""

    dynamic_pressure: float
    """λ [-]."""
    state: str
    """suppressed, suppressed in part (the limit cycle ends, but a motion out of reach grows), not suppressed, passive,
    stable where nothing flutters, destabilised where the controller makes it, or no limit cycle."""
    open_loop_growth_per_s: float
    """Growth rate without control [1/s]."""
    closed_loop_growth_per_s: float | None
    """Growth rate with the controller made for this λ, over all modes [1/s]; None where none exists."""
    damping_time_s: float | None
    """Damping time of the seed protocol with it [s]."""
    robust_damping_time_s: float | None
    """The worst over phases of the limit cycle [s]; None if some phase is not damped, or there is none."""
    mean_damping_time_s: float | None
    """Their mean [s]."""
    peak_voltage_v: float | None
    """Largest voltage on the way [V]."""
    fixed_closed_loop_growth_per_s: float | None
    """Growth rate with the controller made for the design's own λ, kept as it is [1/s]."""
    fixed_robust_damping_time_s: float | None
    """Worst damping time over phases with that one [s]."""


def hold_over(design: Design, pressures: Sequence[float]) -> Iterator[HoldRow]:
    """What a layout does at each λ, with the controller made anew there and with the one made for the design's λ.

    Rows come as they are computed.

    Raises:
        DesignError: the reduction does not serve a simulation.
        ControlError: no controller exists at the design's own λ.
    """
    whole = Plant.of(design)
    plant = whole.symmetric()
    fixed, fixed_whole = law_of(plant), law_of(whole)
    for value in pressures:
        there, all_modes = plant.at_pressure(value), whole.at_pressure(value)
        loop, kept = loop_if_any(there), loop_if_any(there, fixed)
        whole_loop, whole_kept = loop_if_any(all_modes), loop_if_any(all_modes, fixed_whole)
        open_loop = kept or loop
        cycle = limit_cycle(open_loop) if open_loop and there.flutters else None
        robust = robust_damping(loop, cycle) if loop else None
        robust_kept = robust_damping(kept, cycle) if kept else None
        yield HoldRow(
            dynamic_pressure=value,
            state=_state(there, whole_loop, cycle, robust),
            open_loop_growth_per_s=all_modes.growth.real,
            closed_loop_growth_per_s=whole_loop.growth.real if whole_loop else None,
            damping_time_s=seed_protocol(loop).damping_time if loop and there.flutters else None,
            robust_damping_time_s=robust.worst if robust else None,
            mean_damping_time_s=robust.mean if robust else None,
            peak_voltage_v=robust.peak_voltage if robust else None,
            fixed_closed_loop_growth_per_s=whole_kept.growth.real if whole_kept else None,
            fixed_robust_damping_time_s=robust_kept.worst if robust_kept else None,
        )


def _state(plant: Plant, whole: Loop | None, cycle: LimitCycle | None, robust: RobustDamping | None) -> str:
    """A layout's state in a word or two, as in `HoldRow`."""
    steady = whole is not None and stable(whole)
    if plant.passive or not plant.flutters:
        harmed = whole is not None and not steady
        return "destabilised" if harmed else "passive" if plant.passive else "stable"
    if cycle is None:
        return "no limit cycle"
    if robust is None or robust.worst is None:
        return "not suppressed"
    return "suppressed" if steady else "suppressed in part"
