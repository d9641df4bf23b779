"""Owns the plant: the reduced panel in its stream with its patches' forces, linear part and cubic law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from solver.aerodynamics import Stream, design_at_pressure
from solver.design import Design
from solver.errors import DesignError
from solver.flutter import (
    GROWTH_NOISE,
    critical_pressure,
    leading_eigenvalue,
    stiffness_in_stream,
    system_matrix,
)
from solver.mesh import Floats
from solver.modes import ModalModel
from solver.piezo import channel_forces, channels

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Plant:
    """q̈ + C q̇ + K q + f(q) = F V + p in n mass-normalised modes, with |V| limited; X = (q, q̇) is its state."""

    design: Design
    """The design that this is the plant of."""
    stream: Stream
    """The flow, whichever way the design gives it."""
    model: ModalModel
    """The structure in its modes."""
    stiffness: Floats
    """(n, n) K of the flat panel: structure, stresses before deflection and flow [1/s²]; not symmetric."""
    damping: Floats
    """(n, n) C, of the flow [1/s]."""
    force: Floats
    """(n, channels) F, modal force a volt [N/(V·√kg)]."""
    channels: list[tuple[int, ...]]
    """The patched elements on each channel."""

    @staticmethod
    def of(design: Design, model: ModalModel | None = None) -> Plant:
        """The plant of a design; a model may be passed on when only the flow or the control has changed.

        Raises:
            DesignError: the reduction keeps all modes, which serves λ_cr alone, or more than the mesh has.
        """
        if design.reduction.modes == "all":
            raise DesignError("reduction.modes = all: serves λ_cr alone (flutter); give a number to simulate, as 24")
        model = model or ModalModel.of(design)
        stream = Stream.of(design)
        pressure = stream.dynamic_pressure
        return Plant(
            design=design,
            stream=stream,
            model=model,
            stiffness=stiffness_in_stream(model, stream, pressure),
            damping=stream.rate(pressure) * model.bare_mass,
            force=channel_forces(model, design),
            channels=channels(design),
        )

    @property
    def size(self) -> int:
        """Number of modes n."""
        return self.model.size

    @cached_property
    def critical(self) -> tuple[float, float] | None:
        """λ_cr [-] and the flutter frequency [rad/s], in these modes and with the patches on; None if no flutter."""
        return critical_pressure(self.model, self.stream)

    @property
    def passive(self) -> bool:
        """Whether there are patches and λ lies below the patched λ_cr, so that control is not what ends a flutter.

        So it is called even where the bare panel does not flutter either. A panel that is buckled is not passive.
        """
        if not self.channels or self.flutters:
            return False
        return self.critical is None or self.stream.dynamic_pressure < self.critical[0]

    @property
    def flutters(self) -> bool:
        """Whether the flat, uncontrolled panel is unstable at this λ, by more than rounding."""
        return bool(self.growth.real > GROWTH_NOISE * self.model.omega[0])

    @property
    def period(self) -> float:
        """Period of the flat panel's leading root [s], or of its first mode if that root does not turn."""
        return float(2 * np.pi / (self.growth.imag or self.model.omega[0]))

    @cached_property
    def growth(self) -> complex:
        """Leading eigenvalue of the flat, uncontrolled panel: growth rate [1/s] + i·frequency [rad/s]."""
        return leading_eigenvalue(self.system_matrix)

    @cached_property
    def system_matrix(self) -> Floats:
        """(2n, 2n) A of Ẋ = A X + B V (the seed's 3.4)."""
        return system_matrix(self.model, self.stream, self.stream.dynamic_pressure)

    @cached_property
    def input_matrix(self) -> Floats:
        """(2n, channels) B of Ẋ = A X + B V (the seed's 3.3)."""
        return np.vstack([np.zeros_like(self.force), self.force])

    def at_pressure(self, dynamic_pressure: float) -> Plant:
        """The plant at another dynamic pressure λ [-] and the same C_a, in the same modes."""
        return Plant.of(design_at_pressure(self.design, dynamic_pressure), self.model)

    def symmetric(self) -> Plant:
        """The plant in its symmetric modes alone where nothing excites others; otherwise the plant itself."""
        if self.stream.sine or not self.model.plate.mirrored:
            return self
        return Plant.of(self.design, self.model.symmetric())

    def state_space(self) -> control.StateSpace:
        """The linear plant as a python-control object: inputs are channel voltages [V], outputs charges [C].

        The charge is that of the deflection, -K_φb q = Fᵀ q (the seed's 2.20 and 2.22); what a channel's capacitance
        adds for its own voltage is left out.
        """
        import control  # here, because it brings matplotlib with it and few runs need it

        charge = np.hstack([self.force.T, np.zeros_like(self.force.T)])
        names = [f"V{k}" for k in range(len(self.channels))]
        system = control.ss(
            self.system_matrix, self.input_matrix, charge, 0, inputs=names, outputs=[f"Q{k}" for k in range(len(names))]
        )
        assert isinstance(system, control.StateSpace)  # ss makes other kinds from other arguments
        return system
