"""Owns what a search knows of a layout: its figures, and how two layouts compare."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from solver.task import Task

State = Literal[
    "suppressed",
    "in part",
    "not suppressed",
    "no controller",
    "no limit cycle",
    "run failed",
    "failed",
    "unstable",
    "passive",
    "screened",
    "beyond",
]
LINEAR: tuple[State, ...] = ("passive", "screened", "no controller", "unstable", "failed")
"""States that linear figures settle."""


class Score(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A layout and what was found of it."""

    elements: tuple[int, ...]
    """Ids of the patched elements."""
    channels: int
    """Number of channels."""
    mass: float
    """What the patches weigh [kg]."""
    state: State
    """suppressed; in part (the limit cycle ends, but a motion that it does not excite grows; or, by the seed protocol,
    it does not end from every phase); not suppressed; no controller (none of its kind can be made); no limit cycle;
    unstable (under control a motion grows that the limit cycle excites, or any where the task asks for stable layouts);
    passive (without control nothing flutters); screened (its linear figures were not worth a run); beyond (worse than
    `bound`, or never damped); failed and run failed (it could not be computed)."""
    value: float | None = None
    """The objective [its own unit]; None unless suppressed, if only in part. Of reach also where that is less than the
    design's λ, at which the layout then is not suppressed."""
    bound: float | None = None
    """What the objective is worse than, where it was not measured to its end [its own unit]."""
    estimate: float | None = None
    """Damping time of the linear closed loop from the bare panel's limit cycle, the worst over phases [s]."""
    robust_damping_time_s: float | None = None
    """Worst damping time over 8 phases of the limit cycle [s]; of the objective range over its λ as well."""
    mean_damping_time_s: float | None = None
    """Their mean [s]."""
    damping_time_s: float | None = None
    """Damping time of the seed protocol [s]."""
    control_energy_v2s: float | None = None
    """∫ VᵀV dt until damped, the most over phases [V²·s]."""
    suppresses_up_to: float | None = None
    """Largest λ at which the limit cycle is ended from every phase [-], where the objective asks for it."""
    peak_voltage_v: float | None = None
    """Largest voltage over phases [V]."""
    lco_amplitude_over_h: float | None = None
    """Limit cycle without control: peak of |w| at the 0.75 a point over h [-]."""
    lambda_cr: float | None = None
    """λ_cr with the patches on, without control [-]."""
    open_loop_growth_per_s: float | None = None
    """Growth rate without control over all modes, of a range at its highest λ [1/s]."""
    closed_loop_growth_per_s: float | None = None
    """Growth rate with the controller over all modes, of a range the highest [1/s]."""

    @property
    def ranked(self) -> bool:
        """Whether it has a place in the ranking."""
        return self.value is not None


def linear_part(score: Score) -> Score:
    """What linear figures told of a layout before it was run."""
    if score.state in LINEAR:
        return score
    return Score(
        elements=score.elements,
        channels=score.channels,
        mass=score.mass,
        state="screened",
        estimate=score.estimate,
        lambda_cr=score.lambda_cr,
        open_loop_growth_per_s=score.open_loop_growth_per_s,
        closed_loop_growth_per_s=score.closed_loop_growth_per_s,
    )


def merit(task: Task, score: Score) -> tuple[float, ...]:
    """What layouts are sorted by, the best first: measured ones, then bounded ones, then by linear figures."""
    growth = math.inf if score.closed_loop_growth_per_s is None else score.closed_loop_growth_per_s
    estimate = math.inf if score.estimate is None else score.estimate
    rest = (len(score.elements), *score.elements)  # equal ones always in the same order, the lighter first
    if score.value is not None:
        return (0.0, task.cost(score.value), *rest)
    last = {"screened": 1.0, "beyond": 1.0, "not suppressed": 2.0, "unstable": 3.0}.get(score.state, 4.0)
    bound = task.cost(score.bound) if score.bound is not None else math.inf
    return (last, bound, estimate, growth, *rest)
