"""Owns the tail of a run: the closed loop as the linear system that it is for small motions, and a bound on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from solver.ear import LINEAR
from solver.law import closed_loop, extended
from solver.mesh import Floats
from solver.simulate import Loop, Memory, Stretch

FALLING = 0.5  # of the -1 in Lyapunov's equation, which rounding has to leave for the bound to be one


@dataclass(frozen=True)
class Tail:
    """The closed loop as a linear system: its states after each sample of a look, and a bound on all that follow.

    With AᵀP + PA = -1, XᵀPX only falls, and a figure cᵀX never exceeds √(XᵀPX · cᵀP⁻¹c) (Lyapunov).
    """

    powers: Floats
    """(samples, S, S) exp(A_cl t) after each [-]."""
    gain: Floats
    """(channels, S) of what is asked for [V per unit of state]."""
    limit: float
    """Largest voltage [V]."""
    root: Floats | None
    """(S, S) R with P = RᵀR, of the state times `scale`; None where the loop is not stable [√s]."""
    scale: Floats
    """(S,) what the state is multiplied by for that: q by Ω, and so an estimate of it [rad/s, -]."""
    most: float
    """Largest √(cᵀP⁻¹c), of |w| over the limit of what is quiet, and of what is linear, at any point, and of |V| over
    its limit on any channel: below 1, none of them is reached [1/√s]."""

    @staticmethod
    def of(loop: Loop, sample: float, samples: int) -> Tail:
        """The tail of a loop without delay and noise."""
        plant, a = loop.plant, closed_loop(loop.plant, loop.law)
        powers = scipy.linalg.expm(a * sample)[None]
        while len(powers) < samples:
            powers = np.concatenate([powers, powers @ powers[-1]])
        n, gain, limit = plant.size, extended(plant, loop.law)[2], loop.law.limit
        both = np.concatenate([plant.model.omega, np.ones(n)])
        scale = np.concatenate([both, both if loop.law.memory == 2 * n else np.ones(loop.law.memory)])
        root, most = _root(a * scale[:, None] / scale) if loop.growth.real < 0 else None, math.inf
        if root is not None:
            few = plant.design.panel.thickness * min(plant.design.run.settled, LINEAR)
            points = len(plant.model.coarse)
            whole = np.zeros((len(a), points + len(gain)))
            whole[:n, :points] = (plant.model.coarse / (few * plant.model.omega)).T
            whole[:, points:] = (gain / (limit * scale)).T
            most = float(np.linalg.norm(scipy.linalg.solve_triangular(root, whole, trans="T"), axis=0).max())
        return Tail(powers[:samples], gain, limit, root, scale, most)

    def stretch(self, state: Floats, memory: Memory, count: int) -> Stretch:
        """As `Loop.run` with the controller engaged."""
        x = self.powers[:count] @ np.concatenate([state, memory.own])
        kept = Memory(x[-1, len(state) :].copy(), memory.when, memory.asked, memory.drawn)
        return x[:, : len(state)], -x @ self.gain.T, kept

    def quiet_from(self, state: Floats, memory: Memory) -> bool:
        """Whether a motion stays quiet, linear and below the voltage limit from a state (2n,) on, by the bound."""
        if self.root is None:
            return False
        return bool(np.linalg.norm(self.root @ (self.scale * np.concatenate([state, memory.own]))) * self.most < 1.0)


def _root(a: Floats) -> Floats | None:
    """(S, S) R with AᵀRᵀR + RᵀR A = -1, of A (S, S); None where rounding leaves too little of that."""
    form = scipy.linalg.solve_continuous_lyapunov(a.T, -np.eye(len(a)))
    form = (form + form.T) / 2
    change = a.T @ form
    if not np.linalg.eigvalsh(change + change.T)[-1] < -FALLING:
        return None
    try:
        return np.linalg.cholesky(form).T
    except np.linalg.LinAlgError:  # stable by less than rounding
        return None
