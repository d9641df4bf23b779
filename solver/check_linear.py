"""Owns the linear rows of the validation table: frequencies, buckling, critical dynamic pressures, patches."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from solver.aerodynamics import Stream
from solver.buckling import buckling_factor
from solver.case import PATCHED, Case, case_of, design_of
from solver.design import Design, Flow, Load, MeshSize, Panel, Patches, Ply, Reduction
from solver.flutter import critical_pressure, critical_pressure_full, leading_eigenvalue, system_matrix
from solver.laminate import Laminate, flexural_rigidity, moment_per_volt, reference_frequency
from solver.modes import ModalModel
from solver.piezo import element_forces
from solver.plant import Plant

GALERKIN = "Galerkin with sine functions"
GALERKIN_PANELS = "Galerkin; the package panels"
SECOND = "a second BFS code"
PROTOTYPE = "an earlier prototype, same mesh"
NAVIER = "closed form (Navier)"
SQUARE = (12, 12)  # elements, where the mesh must be alike in both directions or bending in both counts


def linear_rows() -> Iterator[Case]:
    """The linear rows, as they are computed."""
    yield from _constants()
    yield from _frequencies()
    yield from _laminates()
    yield from _buckling()
    yield from _critical_pressures()
    yield from _loaded()
    yield from _turned()
    yield from _patched_panel()
    yield from _patch_forces()
    yield from _bimorph()


def _constants() -> Iterator[Case]:
    """Constants of the paper's panel; tolerances are about the last digit that the references are printed to."""
    panel, patches = Panel(), Patches()
    source = "closed form"
    yield case_of("D11 [N·m]", flexural_rigidity(panel), 12.934, 1e-4, source)
    yield case_of("ω0 [rad/s]", reference_frequency(panel), 20.905, 1e-4, source)
    yield case_of("moment per volt and metre [N/V]", moment_per_volt(Design())[0], 0.02793, 2e-4, source)
    yield case_of("coercive voltage [V]", patches.max_field * patches.thickness, 228.6, 1e-4, source)
    frequencies = ModalModel.of(design_of(4, "family")).omega / (2 * np.pi)
    for m, reference in enumerate((65.67, 164.19, 328.37, 558.23)):
        yield case_of(f"frequency of mode ({m + 1},1) [Hz]", frequencies[m], reference, 2e-4, source)


def _frequencies() -> Iterator[Case]:
    """Frequency parameters ω a² √(ρh/D) of panels with free edges, in order of frequency."""
    scale = reference_frequency(Panel())
    hinged = ModalModel.of(design_of(mesh=SQUARE, panel=Panel(edges="sssf"))).omega / scale
    for k, reference in enumerate((11.6845, 27.7563, 41.1967)):
        yield case_of(f"frequency parameter {k + 1}, SSSF", hinged[k], reference, 1e-3, "Leissa 1973, exact (Levy)")


def _laminates() -> Iterator[Case]:
    """Simply supported laminates whose mode (1,1) has a closed form [Hz]."""
    eight = _laminate((0, 90, 0, 90, 90, 0, 90, 0))
    section = Laminate.of(eight)
    d, mass, a = section.bending[0], section.mass[0], eight.panel.length
    exact = np.sqrt((d[0, 0] + 2 * (d[0, 1] + 2 * d[2, 2]) + d[1, 1]) / mass) * np.pi**2 / a**2 / (2 * np.pi)
    yield case_of("frequency of [0/90/0/90]s [Hz]", _hertz(eight), exact, 1e-4, NAVIER + ", Jones 5.84")
    # in-plane edges n are Jones' S3, for which u = U sin cos and v = V cos sin fit the couplings B16 and B26
    angle = _laminate((45, -45, 45, -45), "nnnn")
    section = Laminate.of(angle)
    (stretch, couple, bend), p = (m[0] for m in (section.extension, section.coupling, section.bending)), np.pi / a
    t11 = (stretch[0, 0] + stretch[2, 2]) * p**2
    t12 = (stretch[0, 1] + stretch[2, 2]) * p**2
    t22 = (stretch[1, 1] + stretch[2, 2]) * p**2
    t13 = -(3 * couple[0, 2] + couple[1, 2]) * p**3
    t23 = -(couple[0, 2] + 3 * couple[1, 2]) * p**3
    t33 = (bend[0, 0] + 2 * (bend[0, 1] + 2 * bend[2, 2]) + bend[1, 1]) * p**4
    pulled = np.array([t13, t23]) @ np.linalg.solve(np.array([[t11, t12], [t12, t22]]), np.array([t13, t23]))
    exact = np.sqrt((t33 - pulled) / section.mass[0]) / (2 * np.pi)
    # bilinear in-plane displacements follow the coupling to second order in the mesh
    yield case_of("frequency of [45/-45]2, B ≠ 0 [Hz]", _hertz(angle), exact, 5e-3, NAVIER + ", Jones 5.94")


def _laminate(angles: tuple[float, ...], inplane: str = "iiii") -> Design:
    plies = tuple(Ply("graphite-epoxy", angle, 0.00125 / len(angles)) for angle in angles)
    return design_of(4, mesh=SQUARE, panel=Panel(thickness=0.00125, inplane=inplane, plies=plies))


def _hertz(design: Design) -> float:
    return float(ModalModel.of(design).omega[0] / (2 * np.pi))


def _buckling() -> Iterator[Case]:
    """Loads at which simply supported square panels buckle."""
    panel = Panel()
    along = ModalModel.of(design_of(load=Load(preload_x=1.0))).plate
    yield case_of("buckling load R_x", buckling_factor(along), 4.0, 1e-4, "closed form")
    both = ModalModel.of(design_of(load=Load(preload_x=1.0, preload_y=1.0))).plate
    yield case_of("buckling load R_x = R_y", buckling_factor(both), 2.0, 1e-4, "closed form")
    heated = ModalModel.of(design_of(load=Load(temperature=1.0))).plate
    exact = _critical_heat(panel)
    yield case_of("buckling by uniform heat [K]", buckling_factor(heated), exact, 1e-4, "closed form")


def _critical_heat(panel: Panel) -> float:
    """ΔT at which the square simply supported, immovable panel buckles: E h α ΔT/(1 - ν) = 2π²D/a² [K]."""
    stress = panel.young * panel.thickness * panel.expansion / (1 - panel.poisson)
    return 2 * np.pi**2 * flexural_rigidity(panel) / panel.length**2 / stress


def _critical(design: Design, full: bool = False) -> float | None:
    """λ_cr of a design [-], in its basis or with every mode of the mesh; None if there is no flutter."""
    model, stream = ModalModel.of(design), Stream.of(design)
    found = critical_pressure_full(model, stream) if full else critical_pressure(model, stream)
    return found[0] if found else None


def _critical_pressures() -> Iterator[Case]:
    side = Panel().length
    # λ_cr of a panel of width b rises above the two-dimensional one by about 163 (a/b)²: at 200 a by 1e-5 of itself
    wide = design_of(mesh=(24, 2), panel=Panel(width=200 * side))
    literature = "Galerkin; literature 343.36"
    yield case_of("λ_cr, two-dimensional panel", _critical(wide, full=True), 343.356, 2e-4, literature)
    half = design_of(panel=Panel(width=2 * side))
    yield case_of("λ_cr, SSSS a/b = 0.5", _critical(half, full=True), 384.175, 3e-4, "the package panels")
    exact = 63 * np.pi**4 / 16
    yield case_of("λ_cr, SSSS, modes (1..2,1)", _critical(design_of(2, "family")), exact, 5e-4, "exact, 63π⁴/16")
    four, six = design_of(4, "family"), design_of(6, "family")
    yield case_of("λ_cr, SSSS, modes (1..4,1)", _critical(four), 505.13, 5e-4, "Galerkin; scikit-fem; " + SECOND)
    yield case_of("λ_cr, SSSS, modes (1..6,1)", _critical(six), 511.84, 5e-4, "Galerkin; " + SECOND)
    trap = "exact, 63π⁴/16: (1,1) and (2,1) are all that couples among them"
    yield case_of("λ_cr, SSSS, the four lowest modes", _critical(design_of(4)), exact, 5e-4, trap)
    every = _critical(design_of(), full=True)
    yield case_of("λ_cr, SSSS, all modes", every, 512.649, 2e-4, f"{GALERKIN_PANELS}; {SECOND}", seed=512.0)
    damped = _critical(design_of(damping=0.01), full=True)
    yield case_of("λ_cr, SSSS, C_a = 0.01", damped, 514.91, 5e-4, GALERKIN_PANELS)
    damped_four = _critical(design_of(4, "family", damping=0.01))
    yield case_of("λ_cr, SSSS, C_a = 0.01, modes (1..4,1)", damped_four, 507.26, 5e-4, "Galerkin; " + SECOND)
    strongly = _critical(design_of(damping=0.1), full=True)
    yield case_of("λ_cr, SSSS, C_a = 0.1", strongly, 536.09, 5e-4, GALERKIN)
    clamped = _critical(design_of(panel=Panel(edges="cccc")), full=True)
    yield case_of("λ_cr, CCCC", clamped, 851.15, 1e-3, GALERKIN_PANELS)


def _loaded() -> Iterator[Case]:
    """λ_cr under preload and heat. A square compressed along x to R_x = 2 has the two-dimensional panel's equation."""
    for preload, reference, tol, source in (
        (2.0, 343.356, 2e-4, "exact identity: the two-dimensional panel"),
        (1.5, 384.175, 3e-4, "exact identity: a/b = 0.5"),
    ):
        value = _critical(design_of(load=Load(preload_x=preload)), full=True)
        yield case_of(f"λ_cr, SSSS, R_x = {preload:g}", value, reference, tol, source)
    half = _critical(design_of(load=Load(temperature=_critical_heat(Panel()) / 2)), full=True)
    pressed = _critical(design_of(load=Load(preload_x=1.0, preload_y=1.0)), full=True)
    # the two differ by nothing but how the stress comes about
    yield case_of("λ_cr, SSSS, half the buckling heat", half, pressed or 0.0, 1e-9, "exact identity: R_x = R_y = 1")


def _turned() -> Iterator[Case]:
    """λ_cr in flow from other sides; the references are the same panel's, turned, and hold to rounding."""
    leading, trailing = (
        _critical(design_of(damping=0.01, panel=Panel(edges=edges)), full=True) for edges in ("csss", "scss")
    )
    yield case_of("λ_cr, trailing edge clamped", trailing, leading or 0.0, 1e-6, "exact: leading edge clamped")
    straight, across = (_yawed(yaw, ()) for yaw in (0.0, 90.0))
    yield case_of("λ_cr, SSSS, yaw 90°", across, straight or 0.0, 1e-6, "exact: the square turned")
    eight, turned = _yawed(0.0, (0.0,) * 8), _yawed(90.0, (90.0,) * 8)
    yield case_of("λ_cr, [90]8, yaw 90°", turned, eight or 0.0, 1e-6, "exact: [0]8 turned with its flow")


def _yawed(yaw: float, angles: tuple[float, ...]) -> float | None:
    design = _laminate(angles) if angles else design_of(mesh=SQUARE)
    design = msgspec.structs.replace(design, flow=Flow(damping=0.01, yaw_deg=yaw), reduction=Reduction())
    return _critical(design, full=True)


def _patched_panel() -> Iterator[Case]:
    """λ_cr with the six patches on, C_a = 0.01, in bases of different worth."""
    default = design_of(damping=0.01, elements=PATCHED)
    yield case_of("λ_cr, six patches, default reduction", _critical(default), 545.8, 3e-3, PROTOTYPE)
    yield case_of("λ_cr, six patches, all modes", _critical(default, full=True), 545.8, 3e-3, PROTOTYPE)
    for modes, reference in ((16, 546.7), (24, 545.1)):
        value = _critical(design_of(modes, damping=0.01, elements=PATCHED))
        yield case_of(f"λ_cr, six patches, {modes} lowest modes", value, reference, 1e-3, PROTOTYPE)
    family = _critical(design_of(4, "family", damping=0.01, elements=PATCHED))
    yield case_of("λ_cr, six patches, modes (1..4,1)", family, 496.7, 1e-3, PROTOTYPE)
    aeroelastic = Plant.of(default.with_reduction("aeroelastic", 8))
    rich = ModalModel.of(default.with_reduction("patched", 120))
    root = leading_eigenvalue(system_matrix(rich, aeroelastic.stream, aeroelastic.stream.dynamic_pressure))
    name = "growth rate at λ = 840, six patches, 8 aeroelastic modes [1/s]"
    yield case_of(name, aeroelastic.growth.real, root.real, 1e-3, "120 lowest modes")


def _patch_forces() -> Iterator[Case]:
    """Modal force of the six elements on the bare panel, whose passive mass and stiffness the closed form leaves out.

    On [x1, x2] × [y1, y2] a pair of layers gives, for φ = sin(mπx/a) sin(nπy/b), the modal force M ((m/a)² + (n/b)²)
    a b/(m n) times the differences of cos(mπx/a) and of cos(nπy/b) over the rectangle.
    """
    design = design_of(4, "family")
    panel = design.panel
    a, b = panel.length, panel.width
    moment = moment_per_volt(design)[0]
    amplitude = 2 / np.sqrt(panel.density * panel.thickness * a * b)  # of the mass-normalised sine
    forces = element_forces(ModalModel.of(design), design)[:, list(PATCHED)].sum(axis=1)
    for m in range(1, 5):
        along = abs(np.cos(m * np.pi * 3 / 24) - np.cos(m * np.pi * 6 / 24))
        across = abs(np.cos(np.pi * 2 / 6) - np.cos(np.pi * 4 / 6))
        exact = amplitude * moment * ((m / a) ** 2 + 1 / b**2) * a * b / m * along * across
        # the mesh gives the modes' slopes to about 1e-4; ten times that still catches any wrong factor
        name = f"modal force of six patches on ({m},1) [N/(V·√kg)]"
        yield case_of(name, abs(forces[m - 1]), float(exact), 1e-3, "closed form")


def _bimorph() -> Iterator[Case]:
    """Two layers of PVDF, 1 V across both: the tip of the cantilever moves by 1.5 e31 V L²/(E t²).

    The skin between them is a ten-thousandth of their thickness, so that it is only in name there.
    """
    young, e31, thickness, skin = 2e9, 0.046, 0.001, 1e-7
    patches = Patches(
        elements=tuple(range(20)), thickness=thickness / 2, young=young, poisson=0.0, density=1800.0, d31=e31 / young
    )
    panel = Panel(length=0.1, width=0.005, thickness=skin, edges="cfff", young=young, poisson=0.0)
    design = Design(panel=panel, mesh=MeshSize(10, 2), patches=patches, reduction=Reduction("patched", 12))
    model = ModalModel.of(design)
    force = element_forces(model, design).sum(axis=1) * 0.5
    tip = abs(model.at(panel.length, panel.width / 2) @ (force / model.omega**2))
    exact = "closed form; Hwang and Park 1993"
    # twelve modes hold the constant curvature to a few thousandths
    yield case_of("tip of a PVDF bimorph at 1 V [µm]", 1e6 * float(tip), 0.345, 1e-2, exact)
