"""Owns a run as arrays and what is measured on it: deflection, damping time, amplitude, participation, voltage."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solver.mesh import Bools, Floats
from solver.plant import Plant

LAST_PERIODS = 4  # by which the amplitude at an instant is judged
GROWN = 1.05  # times its amplitude so many periods ago, from which on flutter counts as still growing
PROBE = (0.75, 0.5)  # where limit-cycle amplitudes are read, in parts of a and b: near the peak of the flutter shape


def probe_shapes(plant: Plant) -> Floats:
    """(n,) mode shapes at the 0.75 a, 0.5 b point [1/√kg]."""
    panel = plant.design.panel
    return plant.model.at(PROBE[0] * panel.length, PROBE[1] * panel.width)


def quiet_from(times: Floats, largest: Floats, settled: float) -> float | None:
    """The instant after which something stays below a limit, of samples (samples,) at times; None if it does not."""
    above = np.flatnonzero(~(largest < settled))
    if not len(above):
        return 0.0
    return float(times[above[-1] + 1]) if above[-1] + 1 < len(times) else None


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
        if self.plant.passive or not self.volts.shape[1] or not after.any() or not self.complete:
            return None
        return quiet_from(self.times[after] - run.control_on, self.largest[after], run.settled)

    @property
    def peak_voltage(self) -> float:
        """Largest |V| on any channel [V]."""
        return float(np.abs(self.volts).max(initial=0.0))

    @property
    def end_amplitude(self) -> float:
        """Largest |w| on the panel in the run's last few flutter periods, over h [-]."""
        return self._amplitude_before(self.times[-1])

    @property
    def settled_amplitude(self) -> float | None:
        """The same at t_on; None if the motion was still growing then, or nothing was driven after it."""
        on, span = self.plant.design.run.control_on, LAST_PERIODS * self.plant.period
        if on < 2 * span or not self.peak_voltage:
            return None
        last, earlier = self._amplitude_before(on), self._amplitude_before(on - span)
        return last if last < GROWN * earlier else None

    def _amplitude_before(self, end: float) -> float:
        """Largest |w| on the panel in the few flutter periods up to an instant [s], over h [-]."""
        window = (self.times > end - LAST_PERIODS * self.plant.period) & (self.times <= end)
        return float(self.largest[window].max(initial=0.0))

    @property
    def control_energy(self) -> float:
        """∫ VᵀV dt over all channels, from t_on until damped or the end [V²·s]."""
        driven = self._driven
        return float(np.trapezoid((self.volts[driven] ** 2).sum(axis=1), self.times[driven]))

    @property
    def drive_work(self) -> float:
        """∫ Vᵀ dQ, the work of the patches on the panel in the same time [J]; negative: they take energy out of it."""
        driven = self._driven
        currents = self.states[driven, self.plant.size :] @ self.plant.force
        return float(np.trapezoid((self.volts[driven] * currents).sum(axis=1), self.times[driven]))

    @property
    def _driven(self) -> Bools:
        """(samples,) whether an instant lies between t_on and damped, or the end."""
        start, time = self.plant.design.run.control_on, self.damping_time
        end = self.times[-1] if time is None else start + time
        return (self.times >= start * (1 - 1e-12)) & (self.times <= end * (1 + 1e-12))

    @property
    def saturated_share(self) -> float:
        """Share of the time from t_on until damped (or the end) in which some channel is at its limit [-]."""
        at_limit = np.abs(self.volts[self._driven]) >= self.plant.design.control.voltage_limit * (1 - 1e-12)
        return float(at_limit.any(axis=1).mean()) if at_limit.size else 0.0
