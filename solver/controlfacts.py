"""Owns what a design's controller amounts to in numbers: the facts about its closed loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.design import Design
from solver.holding import Hold, stabilises_up_to, stable, suppresses_up_to
from solver.outcome import outcome_of
from solver.plant import Plant
from solver.reach import out_of_reach
from solver.robust import PHASES, robust_damping
from solver.simulate import Loop, seed_protocol
from solver.trace import Trace

FED = 1.1  # times the amplitude before control, from which on a controller is said to feed the flutter
MODEL_ERROR = 0.1  # relative error of λ that a controller is held against


@dataclass(frozen=True)
class ControlFacts:
    """A design's closed loop."""

    controller: str
    """Its kind: lqr, lqg, rate or off."""
    channels: list[list[int]]
    """Patched elements on each channel."""
    dynamic_pressure: float
    """λ [-]."""
    lambda_cr: float | None
    """λ_cr in the modes of the reduction, patches on, without control [-]."""
    passive: bool
    """Whether the patched λ_cr lies above λ: control is not what ends a flutter here."""
    open_loop_growth_per_s: float
    """Growth rate of the flat panel without control, over all modes of the reduction [1/s]."""
    closed_loop_growth_per_s: float
    """Growth rate with the controller, over all modes of the reduction [1/s]."""
    pole_growth_per_s: list[float]
    """Real parts of the closed loop's poles, the leading one first, one of each conjugate pair [1/s]."""
    pole_frequency_hz: list[float]
    """Their frequencies [Hz]."""
    growth_at_lower_per_s: float
    """Growth rate with this controller where the true λ is 10 % lower than it was made for [1/s]."""
    growth_at_higher_per_s: float
    """Likewise where it is 10 % higher [1/s]."""
    stands_model_error: bool
    """Whether the loop is stable at both."""
    stabilises_up_to: float | None
    """Largest λ at which the controller, made for it, makes the flat panel stable [-]; 0 if it does harm below λ_cr
    already, None if the panel never flutters or nothing is driven."""
    stabilises_beyond: bool
    """Whether it still does there, and no further was looked."""
    suppresses_up_to: float | None
    """Largest λ at which it ends the limit cycle from every phase, under its voltage limit [-]; None likewise."""
    suppresses_beyond: bool
    """Whether it still does there, and no further was looked."""
    damping_time_s: float | None
    """Damping time of the seed protocol [s]; None if never within the run, or passive."""
    robust_damping_time_s: float | None
    """The worst over phases of the limit cycle at which it is switched on [s]; None if some is not damped."""
    mean_damping_time_s: float | None
    """Their mean [s]."""
    phase_damping_times_s: list[float | None]
    """Damping time from each of those phases [s]; None where it is not damped."""
    control_energy_v2s: float
    """∫ VᵀV dt of the seed protocol, from t_on until damped or the end [V²·s]."""
    drive_work_j: float
    """Work of the patches on the panel in that time [J]; negative: they take energy out of it."""
    end_amplitude_over_h: float
    """Largest |w| in the last four flutter periods of it, over h [-]."""
    peak_voltage_v: float
    """Largest voltage on any channel, in the seed protocol [V]."""
    saturated_share: float
    """Share of that time with a channel at its limit [-]."""
    warnings: list[str]
    """What the patches cannot reach, what limits the controller, and settings that it does not use."""


def control_facts(design: Design, phases: int = PHASES) -> ControlFacts:
    """Close the loop of a design and measure it.

    Args:
        design: the design.
        phases: of the limit cycle at which the controller is switched on.

    Raises:
        DesignError: the reduction does not serve a simulation.
        ControlError: the design's controller does not exist.
    """
    whole = Plant.of(design)
    plant = whole.symmetric()
    loop, all_modes = Loop.of(plant), Loop.of(whole)
    trace = seed_protocol(loop)
    robust = robust_damping(loop, outcome_of(loop).cycle, phases) if plant.flutters else None
    poles = all_modes.poles[all_modes.poles.imag >= 0]
    poles = poles[np.argsort(-poles.real)]
    lower, higher = (_elsewhere(whole, all_modes, 1 + sign * MODEL_ERROR) for sign in (-1, 1))
    linear = stabilises_up_to(whole)
    nonlinear = suppresses_up_to(whole, linear)
    return ControlFacts(
        controller=design.control.kind,
        channels=[list(group) for group in plant.channels],
        dynamic_pressure=plant.stream.dynamic_pressure,
        lambda_cr=whole.critical[0] if whole.critical else None,
        passive=plant.passive,
        open_loop_growth_per_s=whole.growth.real,
        closed_loop_growth_per_s=all_modes.growth.real,
        pole_growth_per_s=poles.real.tolist(),
        pole_frequency_hz=(poles.imag / (2 * np.pi)).tolist(),
        growth_at_lower_per_s=lower.growth.real,
        growth_at_higher_per_s=higher.growth.real,
        stands_model_error=stable(lower) and stable(higher),
        stabilises_up_to=linear.dynamic_pressure if linear else None,
        stabilises_beyond=bool(linear and linear.open_ended),
        suppresses_up_to=nonlinear.dynamic_pressure if nonlinear else None,
        suppresses_beyond=bool(nonlinear and nonlinear.open_ended),
        damping_time_s=trace.damping_time,
        robust_damping_time_s=robust.worst if robust else None,
        mean_damping_time_s=robust.mean if robust else None,
        phase_damping_times_s=[float(t) if np.isfinite(t) else None for t in robust.times] if robust else [],
        control_energy_v2s=trace.control_energy,
        drive_work_j=trace.drive_work,
        end_amplitude_over_h=trace.end_amplitude,
        peak_voltage_v=trace.peak_voltage,
        saturated_share=trace.saturated_share,
        warnings=[*plant.stream.notes, *control_warnings(whole, trace), *_limits(linear)],
    )


def control_warnings(whole: Plant, trace: Trace) -> list[str]:
    """What a user should know of a design's control, a line each.

    That is what is out of reach, a flutter that the controller feeds instead of damping it, and what is not used.

    Args:
        whole: the panel in all its modes.
        trace: its run of the seed protocol.
    """
    lines, control = [], whole.design.control
    if control.kind != "off" and not whole.passive:
        lines += out_of_reach(whole)
    before = trace.settled_amplitude
    if before is not None and trace.damping_time is None and trace.end_amplitude > FED * before:
        lines.append(
            f"the controller feeds the flutter: |w| is {trace.end_amplitude:.3g} h at the end of the run, and was "
            f"{before:.3g} h when it was switched on"
        )
    if control.kind == "lqr" and control.sensor_noise:
        lines.append("control.sensor_noise is not used: lqr reads the state itself; take lqg or rate")
    return lines


def _limits(linear: Hold | None) -> list[str]:
    if linear is None or linear.open_ended:
        return []
    where = f"beyond λ = {linear.dynamic_pressure:.1f}" if linear.dynamic_pressure else "the controller holds at no λ"
    return [f"{where}: {linear.reason}"]


def _elsewhere(plant: Plant, loop: Loop, factor: float) -> Loop:
    """A loop's own law on the plant at another λ."""
    return Loop.of(plant.at_pressure(factor * plant.stream.dynamic_pressure), loop.law)
