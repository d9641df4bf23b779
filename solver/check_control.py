"""Owns the rows of the validation table about control: gains, separation, delay, authority."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import msgspec
import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from solver.authority import regulator_cost
from solver.case import PATCHED, Case, case_of, design_of
from solver.design import Design
from solver.law import closed_loop, extended
from solver.mesh import Floats
from solver.observer import Lqg, kalman_gain
from solver.passive import patch_growth
from solver.piezo import element_forces
from solver.plant import Plant
from solver.regulator import Lqr, lqr_gain
from solver.simulate import Loop

TOOLBOX = "python-control"
DELAY = 1e-4  # s: 0.1 rad of the flutter, 1 rad of the modes that a regulator makes stiff
MIDDLE = 44  # i = 7, j = 2: where one patch more calms the bare panel most


def control_rows() -> Iterator[Case]:
    """The rows about control, as they are computed."""
    design = design_of(elements=PATCHED, damping=0.01)
    plant = Plant.of(design).symmetric()
    yield from _gains(plant)
    yield from _separation(_with(design, kind="lqg"))
    yield from _delay(_with(design, delay=DELAY))
    yield from _authority(design.with_elements(()))


def _with(design: Design, kind: Literal["lqr", "lqg"] = "lqr", delay: float = 0.0) -> Plant:
    control = msgspec.structs.replace(design.control, kind=kind, delay=delay)
    return Plant.of(design.with_control(control)).symmetric()


def _gains(plant: Plant) -> Iterator[Case]:
    """Both gains by the toolbox, which solves the same equations without scaling; ω² spans six decades there."""
    toolbox: Any = __import__("control")  # its functions are typed for fewer arguments than they take
    n, control = plant.size, plant.design.control
    system, weights = plant.state_space(), np.concatenate([plant.model.omega**2, np.ones(n)])
    q, r = control.state_weight * np.diag(weights), control.effort_weight * np.eye(system.ninputs)
    gain = toolbox.lqr(system, q, r)[0]
    ours = float(np.linalg.norm(lqr_gain(plant, plant.force)))
    yield case_of("norm of the LQR gain, six patches, λ = 840", ours, float(np.linalg.norm(gain)), 1e-6, TOOLBOX)
    noise = np.vstack([np.zeros((n, n)), np.eye(n)])
    charge = np.hstack([plant.force.T, np.zeros_like(plant.force.T)])
    sensor = np.eye(len(charge)) / control.observer_weight**2
    gain = toolbox.lqe(plant.system_matrix, noise, charge, np.eye(n), sensor)[0]
    ours = float(np.linalg.norm(kalman_gain(plant, plant.force)))
    yield case_of("norm of the Kalman gain, likewise", ours, float(np.linalg.norm(gain)), 1e-6, TOOLBOX)


def _separation(plant: Plant) -> Iterator[Case]:
    """Poles of the LQG loop are the regulator's and the observer's: compared by the sum of their moduli."""
    lqg = Lqg.of(plant)
    charge = np.hstack([plant.force.T, np.zeros_like(plant.force.T)])
    apart = [plant.system_matrix - plant.input_matrix @ lqg.gain, plant.system_matrix - lqg.filter_gain @ charge]
    expected = sum(float(np.abs(np.linalg.eigvals(matrix)).sum()) for matrix in apart)
    found = float(np.abs(np.linalg.eigvals(closed_loop(plant, lqg.law(plant)))).sum())
    name, source = "sum of the moduli of the LQG loop's poles [1/s]", "regulator's and observer's, apart"
    yield case_of(name, found, expected, 1e-8, source)


def _delay(plant: Plant) -> Iterator[Case]:
    """The leading pole of a delayed loop, against the root of det(s - A + B K exp(-sτ))."""
    law = Lqr.of(plant).law(plant)
    growth = Loop.of(plant, law).growth
    a, b, k = extended(plant, law)

    def residual(parts: Floats) -> list[float]:
        s = complex(parts[0], parts[1])
        opened = k @ np.linalg.solve(s * np.eye(len(a)) - a, b)
        value = complex(np.linalg.det(np.eye(len(k)) + np.exp(-s * DELAY) * opened))
        return [value.real, value.imag]

    root = scipy.optimize.fsolve(residual, [1.01 * growth.real, growth.imag], xtol=1e-12)
    name = f"growth rate with a delay of {1e3 * DELAY:g} ms [1/s]"
    yield case_of(name, growth.real, float(root[0]), 1e-6, "root of the characteristic equation")


def _authority(bare: Design) -> Iterator[Case]:
    """The passive effect of one patch by rebuilding the panel, one element's H2 cost by Lyapunov's equation."""
    before, after = _growth_full(bare), _growth_full(bare.with_elements((MIDDLE,)))
    found = float(patch_growth(bare)[MIDDLE])
    yield case_of("growth by one patch at i = 7, j = 2 [1/s]", found, after - before, 1e-6, "panel rebuilt with it")
    plant, element = Plant.of(bare), PATCHED[0]
    control, n = bare.control, plant.size
    force = element_forces(plant.model, bare)[:, [element]]
    gain = lqr_gain(plant, force)
    closed = plant.system_matrix - np.vstack([np.zeros_like(force), force]) @ gain
    weights = np.diag(np.concatenate([plant.model.omega**2, np.ones(n)])) * control.state_weight
    cost = scipy.linalg.solve_continuous_lyapunov(closed.T, -(weights + control.effort_weight * gain.T @ gain))
    reference = float(np.trace(cost[n:, n:]))
    found = regulator_cost(plant, force)
    yield case_of("H2 cost of element i = 3, j = 2 [V²·kg/(N²·s)]", found, reference, 1e-5, "Lyapunov's equation")


def _growth_full(design: Design) -> float:
    """Growth rate of the fluttering root with every mode of the mesh [1/s], by shift-and-invert near the reduced."""
    plant = Plant.of(design)
    plate, stream, near = plant.model.plate, plant.stream, plant.growth
    pressure = stream.dynamic_pressure
    stiffness = plate.stiffness + pressure * stream.slope_unit * plate.space.slope_x
    n, rate = plate.mass.shape[0], abs(near)  # the unit of 1/time, so that displacements and rates weigh alike
    one = sp.eye_array(n)
    left = sp.block_array([[None, rate * one], [-stiffness / rate, -stream.rate(pressure) * plate.space.bare_mass]])
    right = sp.block_diag([one, plate.mass])
    # complex, because of a real matrix ARPACK would take the real part of the shifted inverse alone
    pair = (sp.csc_array(matrix, dtype=complex) for matrix in (left, right))
    values = spla.eigs(next(pair), 4, next(pair), sigma=near, return_eigenvectors=False)
    return float(values.real.max())
