"""Owns the task of a placement search: the method, what it ranks layouts by, and which layouts are allowed."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from solver.design import Design
from solver.errors import DesignError
from solver.parts import Part, require

Method = Literal["nfcg", "iterative", "greedy", "exhaustive", "genetic"]
Objective = Literal["robust", "seed", "reach", "range", "energy"]
Shapes = Literal["rectangles", "pairs", "both"]

UNITS: dict[Objective, str] = {"robust": "s", "seed": "s", "reach": "-", "range": "s", "energy": "V²·s"}
TITLES: dict[Objective, str] = {
    "robust": "worst damping time over phases",
    "seed": "damping time of the seed protocol",
    "reach": "λ up to which the limit cycle is ended",
    "range": "worst damping time over λ",
    "energy": "control energy, the most over phases",
}
MOST_PRESSURES = 50  # of a range, each a search's whole work once more


class Task(Part, frozen=True):
    """What a placement search looks for, and how."""

    method: Method = "iterative"
    """nfcg: the elements of highest NFCG, and sets grown of them; iterative: the paper's, random layouts around these,
    improving; greedy: add, remove and swap; exhaustive: every rectangle that the task allows; genetic: NSGA-II over
    objective and number."""
    objective: Objective = "robust"
    """robust: worst damping time over 8 phases of the limit cycle; seed: that of the seed protocol; reach: largest λ at
    which the limit cycle is ended, looked for up to 4 λ_cr; range: worst damping time over `pressures`; energy: most
    ∫V² dt over phases."""
    pressures: tuple[float, ...] = ()
    """Dynamic pressures λ of the objective range [-]."""
    elements: int | None = None
    """Most patched elements; without it as many as the design has, or any number for exhaustive."""
    channels: int | None = None
    """Most channels."""
    mass: float | None = None
    """Most that the patches weigh [kg]."""
    voltage_limit: float | None = None
    """Largest voltage any drive gives [V]: every layout runs under it, instead of the design's own."""
    keep_out: tuple[int, ...] = ()
    """Elements that stay bare."""
    symmetric: bool = True
    """Only layouts symmetric about y = b/2; on a symmetric panel they take a fraction of the time."""
    stable: bool = False
    """Only layouts whose controller makes every motion of the flat panel decay, those too that nothing excites."""
    shapes: Shapes = "rectangles"
    """What exhaustive goes through: rectangles, pairs of them that mirror each other about y = b/2, or both."""
    seed: int = 0
    """Seed of the methods that draw at random; the same one gives the same ranking."""
    evaluations: int | None = None
    """Most layouts to look at; without it the method ends by itself."""
    top: int = 10
    """How many of the best are measured in full for sure; what a bound shows to be worse than these is cut short."""

    def __post_init__(self) -> None:
        """Refuse a task that makes no sense, whatever the design."""
        for name in ("elements", "channels", "evaluations", "top"):
            value = getattr(self, name)
            require(value is None or 1 <= value <= 1_000_000, name, value, "must be a number from 1 on")
        if self.mass is not None:
            require(0 < self.mass < 1e30, "mass", self.mass, "must be a positive number [kg]")
        if self.voltage_limit is not None:
            require(0 < self.voltage_limit < 1e30, "voltage_limit", self.voltage_limit, "must be a positive number [V]")
        require(0 <= self.seed < 2**32, "seed", self.seed, "must be from 0 to 2^32 - 1")
        require(
            bool(self.pressures) == (self.objective == "range"),
            "pressures",
            list(self.pressures) or "none",
            "go with the objective range, and that with them: --objective range --pressures 600 900 1200",
        )
        require(
            len(self.pressures) <= MOST_PRESSURES, "pressures", f"{len(self.pressures)}", f"at most {MOST_PRESSURES}"
        )
        for value in self.pressures:
            require(0 < value <= 1e5 and math.isfinite(value), "pressures", value, "must be λ from 0 to 1e5")

    @property
    def descending(self) -> bool:
        """Whether a larger value of the objective is the better one."""
        return self.objective == "reach"

    def cost(self, value: float) -> float:
        """A value of the objective as a number that is smaller for the better one."""
        return -value if self.descending else value


def task_for(task: Task, design: Design) -> Task:
    """The task with what a design fills in: the number of elements, in ascending order what is kept bare.

    Raises:
        DesignError: design and task do not go together.
    """
    count = design.mesh.nx * design.mesh.ny
    for e in task.keep_out:
        require(0 <= e < count, "keep_out", e, f"the mesh has elements 0 to {count - 1}")
    if design.control.kind == "off":
        raise DesignError("control.kind = off: a search needs a controller; choose lqr, lqg or rate")
    if design.run.duration <= design.run.control_on:
        raise DesignError("run.duration = run.control_on: the run has no time for control; make it longer")
    elements = task.elements
    if elements is None and task.method != "exhaustive":
        elements = len(design.patches.elements) or None
        if elements is None:
            raise DesignError(f"elements: {task.method} needs the most elements to patch, as --elements 6")
    return msgspec.structs.replace(
        task,
        elements=elements,
        keep_out=tuple(sorted(set(task.keep_out))),
        pressures=tuple(sorted(set(task.pressures))),
    )
