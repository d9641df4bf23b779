"""Owns the Design: all that a user chooses about a panel, its flow, patches, control and run, and nothing derived."""

from __future__ import annotations

from typing import Literal

import msgspec

from solver.parts import Flow, Load, MeshSize, Panel, Part, Patches, Ply, require, require_positive

__all__ = ["Control", "Design", "Flow", "Load", "MeshSize", "Panel", "Patches", "Ply", "Reduction", "Run"]

Basis = Literal["patched", "family", "aeroelastic"]
Weighting = Literal["energy", "identity", "diagonal"]

SCHEMA_VERSION = 1
MOST_MODES = 120  # of a basis whose cubic law is asked for: at the fourth power of their number, it would fill memory
LEAST_DELAY, MOST_DELAY = 1e-5, 0.01  # s: a run takes steps as short as the delay, eigenvalues a delay line as long
MAX_ELEMENTS = 10_000  # a 100 x 100 mesh; dense modal matrices beyond it no longer fit the memory of a laptop


class Control(Part, frozen=True):
    """The controller that drives the patches, and the drive and sensors it has to work with."""

    kind: Literal["lqr", "lqg", "rate", "off"] = "lqr"
    """lqr: linear quadratic regulator of the full state; lqg: the same on a Kalman filter's estimate from the patches'
    charges; rate: each channel against the current of its own patches; off: no control."""
    weighting: Weighting = "energy"
    """Q of lqr and lqg. energy: s·blockdiag(K, M), twice the mechanical energy; identity: s·I in mass-normalised
    modes; diagonal: s·diag(diagonal)."""
    state_weight: float = 1e6
    """Weight s on the state: [V²/J] by energy; [V²/(kg·m²)] and [V²·s²/(kg·m²)] on q and q̇ otherwise."""
    diagonal: tuple[float, ...] = ()
    """Diagonal of Q/s by hand [-]: every mode's amplitude, then every mode's rate, in the order of the modes."""
    effort_weight: float = 10.0
    """Weight R on the squared voltage of each channel [-]."""
    voltage_limit: float = 228.6
    """Largest voltage the drive gives [V]."""
    observer_weight: float = 1e9
    """What the Kalman filter assumes: modal disturbance over sensor noise, both white [N/(√kg·C)]."""
    rate_gain: float = 1e5
    """Voltage a unit current of a channel's own patches, with rate [V/A]."""
    delay: float = 0.0
    """Time from what a controller asks for to what its drive gives [s]."""
    sensor_noise: float = 0.0
    """White noise of every sensor, one-sided amplitude density: of its charge with lqg [C/√Hz], of its current with
    rate [A/√Hz]. lqr reads the state itself and has none."""
    noise_seed: int = 0
    """Seed of the noise."""

    def __post_init__(self) -> None:
        """Refuse weights for which no regulator exists, and drives that cannot be."""
        require_positive(
            "control",
            state_weight=self.state_weight,
            effort_weight=self.effort_weight,
            voltage_limit=self.voltage_limit,
        )
        ratio = self.state_weight / self.effort_weight
        require(
            1e-6 <= ratio <= 1e12,
            "control.state_weight / control.effort_weight",
            f"{ratio:g}",
            "must be from 1e-6 to 1e12: beyond it the Riccati equation cannot be solved in doubles",
        )
        for k, weight in enumerate(self.diagonal):
            require(0 <= weight <= 1e12, f"control.diagonal[{k}]", weight, "must be from 0 to 1e12")
        require(
            bool(self.diagonal) == (self.weighting == "diagonal"),
            "control.diagonal",
            self.diagonal or "empty",
            "goes with control.weighting = diagonal, and that with it",
        )
        require(
            1e3 <= self.observer_weight <= 1e15,
            "control.observer_weight",
            self.observer_weight,
            "must be from 1e3 to 1e15 N/(√kg·C)",
        )
        require(0 <= self.rate_gain <= 1e12, "control.rate_gain", self.rate_gain, "must be from 0 to 1e12 V/A")
        require(
            self.delay == 0 or LEAST_DELAY <= self.delay <= MOST_DELAY,
            "control.delay",
            f"{self.delay} s",
            f"must be 0 or from {LEAST_DELAY:g} to {MOST_DELAY:g} s",
        )
        require(0 <= self.sensor_noise <= 1, "control.sensor_noise", self.sensor_noise, "must be from 0 to 1 C/√Hz")
        require(0 <= self.noise_seed < 2**32, "control.noise_seed", self.noise_seed, "must be from 0 to 2^32 - 1")


class Reduction(Part, frozen=True):
    """The modal basis that the motion is described in."""

    basis: Basis = "patched"
    """patched: lowest modes of the panel with its patches on; family: the (m,1) shapes m = 1, 2, …; aeroelastic: the
    space of right and left eigenvectors of the panel in its stream."""
    modes: int | Literal["all"] = 24
    """How many modes; all (every one the mesh has) is for λ_cr alone."""

    def __post_init__(self) -> None:
        """Refuse a basis too small to flutter (two modes must meet) or too large for its cubic law."""
        if self.modes != "all":
            require(
                2 <= self.modes <= MOST_MODES, "reduction.modes", self.modes, f"must be from 2 to {MOST_MODES}, or all"
            )


class Run(Part, frozen=True):
    """The seed protocol: start in the first mode, flutter freely, then switch the controller on."""

    initial_amplitude: float = 0.1
    """Largest |w| at the start, in the first mode at rest, over the thickness h [-]."""
    control_on: float = 0.2
    """Instant t_on at which the controller is switched on [s]."""
    duration: float = 0.8
    """Length of the run [s]."""
    settled: float = 0.0005
    """The panel counts as damped once its largest |w| over h stays below this [-]."""

    def __post_init__(self) -> None:
        """Refuse a run that has no beginning or no end."""
        require_positive("run", initial_amplitude=self.initial_amplitude, duration=self.duration, settled=self.settled)
        require(self.initial_amplitude <= 10, "run.initial_amplitude", self.initial_amplitude, "must be at most 10 (h)")
        require(
            1e-3 <= self.duration <= 60, "run.duration", self.duration, "must be from 0.001 to 60 s of simulated time"
        )
        require(self.control_on >= 0, "run.control_on", self.control_on, "must be a time from 0 on [s]")


class Design(Part, frozen=True):
    """All that a user chose; everything else in `solver` is a function of it. SI units throughout."""

    schema_version: int = SCHEMA_VERSION
    """Version of this file format."""
    panel: Panel = Panel()
    """The bare panel."""
    mesh: MeshSize = MeshSize()
    """The finite-element mesh."""
    flow: Flow = Flow()
    """The stream."""
    load: Load = Load()
    """Preload and heat."""
    patches: Patches = Patches()
    """The patches and their wiring."""
    control: Control = Control()
    """The controller."""
    reduction: Reduction = Reduction()
    """The modal basis."""
    run: Run = Run()
    """The run in time."""

    def __post_init__(self) -> None:
        """Check what depends on more than one field; each alone was checked by its part."""
        require(
            self.schema_version == SCHEMA_VERSION,
            "schema_version",
            self.schema_version,
            f"this version of flutterviz reads {SCHEMA_VERSION}",
        )
        panel, count = self.panel, self.mesh.nx * self.mesh.ny
        require(
            panel.thickness <= 0.1 * min(panel.length, panel.width),
            "panel.thickness",
            f"{panel.thickness} m",
            "a thin plate is at most a tenth of its shorter side; use a smaller thickness",
        )
        require(count <= MAX_ELEMENTS, "mesh.nx * mesh.ny", count, f"must be at most {MAX_ELEMENTS} elements")
        require(
            self.run.control_on <= self.run.duration,
            "run.control_on",
            f"{self.run.control_on} s",
            f"must lie within the run, 0 to run.duration = {self.run.duration} s",
        )
        for e in self.patches.elements:
            require(
                0 <= e < count,
                "patches.elements",
                e,
                f"the {self.mesh.nx} x {self.mesh.ny} mesh has elements 0 to {count - 1}",
            )
        states = 2 * self.reduction.modes if self.reduction.modes != "all" else None
        require(
            self.control.weighting != "diagonal" or states is None or len(self.control.diagonal) == states,
            "control.diagonal",
            f"{len(self.control.diagonal)} numbers",
            f"reduction.modes = {self.reduction.modes} takes {states}: every mode's amplitude, then every mode's rate",
        )
        coercive = self.patches.ceramic.max_field * self.patches.thickness
        require(
            self.control.voltage_limit <= coercive * (1 + 1e-9),
            "control.voltage_limit",
            f"{self.control.voltage_limit} V",
            f"the ceramic loses its poling beyond patches.max_field x patches.thickness = {coercive:.4g} V",
        )

    def with_elements(self, elements: tuple[int, ...]) -> Design:
        """The same design with another set of patched elements."""
        return msgspec.structs.replace(self, patches=msgspec.structs.replace(self.patches, elements=elements))

    def with_dynamic_pressure(self, value: float) -> Design:
        """The same design at another dynamic pressure λ [-], no longer given by a Mach number."""
        return msgspec.structs.replace(self, flow=msgspec.structs.replace(self.flow, dynamic_pressure=value, mach=None))

    def with_control(self, control: Control) -> Design:
        """The same design with another controller."""
        return msgspec.structs.replace(self, control=control)

    def with_load(self, load: Load) -> Design:
        """The same design under another preload or heat."""
        return msgspec.structs.replace(self, load=load)

    def with_reduction(self, basis: Basis, modes: int | Literal["all"]) -> Design:
        """The same design in another modal basis.

        Weights by hand belong to the modes they were chosen for: with another number of modes, energy weighs again.
        """
        control = self.control
        if control.weighting == "diagonal" and modes != self.reduction.modes:
            control = msgspec.structs.replace(control, weighting="energy", diagonal=())
        return msgspec.structs.replace(self, reduction=Reduction(basis, modes), control=control)
