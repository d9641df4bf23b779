"""Owns a run as arrays and what is measured on it: deflection, damping time, amplitude, participation, voltage."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solver.mesh import Floats
from solver.plant import Plant

PROBE = (0.75, 0.5)  # where limit-cycle amplitudes are read, in parts of a and b: near the peak of the flutter shape


def probe_shapes(plant: Plant) -> Floats:
    """(n,) mode shapes at the 0.75 a, 0.5 b point [1/√kg]."""
    panel = plant.design.panel
    return plant.model.at(PROBE[0] * panel.length, PROBE[1] * panel.width)


@dataclass(frozen=True)
class Trace:
    """A run sampled at equal intervals."""

    plant: Plant
    """The plant that ran."""
    times: Floats
    """(samples,) time [s]."""
    states: Floats
    """(samples, 2n) amplitudes q [m·√kg] and rates q̇ [m·√kg/s]."""
    volts: Floats
    """(samples, channels) voltage of each channel [V]."""
    complete: bool = True
    """Whether the run reached its end; a motion that diverges is cut off."""

    @property
    def amplitudes(self) -> Floats:
        """(samples, n) modal amplitudes q [m·√kg]."""
        return self.states[:, : self.plant.size]

    @cached_property
    def probe(self) -> Floats:
        """(samples,) w at the 0.75 a point over h [-]."""
        return self.amplitudes @ probe_shapes(self.plant) / self.plant.design.panel.thickness

    @cached_property
    def largest(self) -> Floats:
        """(samples,) largest |w| on the panel over h [-], on a grid of 2 by 4 points an element."""
        shapes = self.plant.model.coarse
        result = np.empty(len(self.times))
        for k in range(0, len(result), 512):  # a few MB at a time
            result[k : k + 512] = np.abs(self.amplitudes[k : k + 512] @ shapes.T).max(axis=1)
        return result / self.plant.design.panel.thickness

    @cached_property
    def modal(self) -> Floats:
        """(samples, n) largest deflection that each mode contributes, q_r max|φ_r| over h [-]."""
        return self.amplitudes * self.plant.model.peak / self.plant.design.panel.thickness

    @property
    def damping_time(self) -> float | None:
        """Time from t_on to the instant after which the largest |w| stays below `run.settled`·h [s].

        None if that is not reached in the run, or the layout is passive (then control is not what damped it).
        """
        run = self.plant.design.run
        after = self.times >= run.control_on * (1 - 1e-12)
        above = np.flatnonzero(self.largest[after] >= run.settled)
        times = self.times[after]
        if self.plant.passive or not self.volts.shape[1] or not len(times) or not self.complete:
            return None
        if not len(above):
            return 0.0
        if above[-1] + 1 == len(times):
            return None
        return float(times[above[-1] + 1] - run.control_on)

    @property
    def peak_voltage(self) -> float:
        """Largest |V| on any channel [V]."""
        return float(np.abs(self.volts).max(initial=0.0))

    @property
    def saturated_share(self) -> float:
        """Share of the time from t_on until damped (or the end) in which some channel is at its limit [-]."""
        run = self.plant.design.run
        end = run.control_on + self.damping_time if self.damping_time is not None else self.times[-1]
        window = (self.times >= run.control_on) & (self.times <= end)
        at_limit = np.abs(self.volts[window]) >= self.plant.design.control.voltage_limit * (1 - 1e-12)
        return float(at_limit.any(axis=1).mean()) if at_limit.size else 0.0
