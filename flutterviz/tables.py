"""Owns what commands show on the terminal: tables on stdout, warnings on stderr."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from solver import (
    AuthorityMap,
    ControlFacts,
    Design,
    ErrorEstimate,
    FlutterFacts,
    HoldRow,
    RunFacts,
    Stream,
    SweepRow,
)

# wide enough for a table's rows where the output goes into a file
OUT, ERR = Console(width=None if sys.stdout.isatty() else 140), Console(stderr=True)


def warn(lines: Sequence[str]) -> None:
    """Say on stderr what to mind, a line each."""
    for line in lines:
        ERR.print(f"warning: {line}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def print_flutter(design: Design, facts: FlutterFacts) -> None:
    """Show what `flutter` found."""
    count = len(design.patches.elements)
    table = Table(title=f"flutter, C_a = {facts.aerodynamic_damping:.4g}, {count} patched elements", show_header=False)
    name = "λ_cr of the flat state" if facts.buckled else "λ_cr"
    table.add_row(name, number(facts.lambda_cr, ".2f", "none up to λ = 20 000"))
    table.add_row(f"λ_cr in {facts.modes} modes", number(facts.lambda_cr_in_basis, ".2f", "none up to λ = 20 000"))
    table.add_row("flutter frequency", number(facts.flutter_frequency_hz, ".2f Hz", "–"))
    table.add_row("q/β at λ_cr", number(facts.pressure_cr_pa, ".1f Pa", "–"))
    if design.flow.mach is not None:
        given = f"{facts.dynamic_pressure:.2f}, C_a = {facts.aerodynamic_damping:.4f}"
        table.add_row(f"λ at Mach {design.flow.mach:g}, {design.flow.altitude:g} m", given)
    if facts.buckling_factor is not None:
        table.add_row("buckles in still air at", f"{facts.buckling_factor:.4f} of preload and heat")
    if facts.rests_up_to is not None:
        table.add_row("rests in its deflection up to", f"λ = {facts.rests_up_to:.2f}, then {facts.then}")
    for state in facts.static_states:
        stable = "stable" if state.stable else "unstable"
        table.add_row("static state", f"w/h = {state.deflection_over_h:+.4f} at 0.75 a, {stable}")
    table.add_row("natural frequencies [Hz]", "  ".join(f"{f:.1f}" for f in facts.frequencies_hz[:12]))
    OUT.print(table)


def print_sweep(field: str, rows: list[SweepRow]) -> None:
    """Show the rows of a sweep."""
    table = Table(title=f"sweep over {field}, upwards and back")
    for head in (field, "", "growth [1/s]", "motion", "limit cycle w/h", "[Hz]", "Floquet", "damping time [s]", "λ_cr"):
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(
            f"{row.value:g}",
            row.direction,
            f"{row.growth_per_s:+.2f}",
            f"{row.motion or '–'}{', snapping' if row.snap_through else ''}",
            number(row.lco_amplitude_over_h, ".4f", "–")
            + (" ?" if row.lco_amplitude_over_h and not row.lco_converged else ""),
            number(row.lco_frequency_hz, ".2f", "–"),
            number(row.floquet, ".4f", "–"),
            "passive" if row.passive else number(row.damping_time_s, ".4f", "–"),
            number(row.lambda_cr, ".2f", "none"),
        )
    OUT.print(table)


def print_run(facts: RunFacts, cycles: bool) -> None:
    """Show a run, and what was asked for beside it."""
    table = Table(title=f"seed protocol at λ = {facts.dynamic_pressure:g}", show_header=False)
    resting = facts.motion if facts.motion in ("buckled", "deflected") else None
    state = resting or ("passive" if facts.passive else "flutters" if facts.flutters else "stable")
    table.add_row("state", "diverged" if facts.diverged else state)
    table.add_row("λ_cr with patches", number(facts.lambda_cr, ".2f", "none"))
    table.add_row("damping time", number(facts.damping_time_s, ".4f s", "never in this run" if facts.flutters else "–"))
    if facts.motion is not None:
        chaos = f", Lyapunov exponent {facts.lyapunov_per_s:+.1f} /s" if facts.motion == "chaotic" else ""
        table.add_row(
            "uncontrolled, settles into", facts.motion + (", snapping through" if facts.snap_through else "") + chaos
        )
        if facts.lco_amplitude_over_h is None and facts.motion_amplitude_over_h:
            table.add_row("peak of it, w/h at 0.75 a", f"{facts.motion_amplitude_over_h:.4f}")
    table.add_row("limit cycle, w/h at 0.75 a", number(facts.lco_amplitude_over_h, ".4f", "–"))
    table.add_row("limit cycle frequency", number(facts.lco_frequency_hz, ".2f Hz", "–"))
    if facts.lco_floquet is not None:
        table.add_row("Floquet multiplier", f"{facts.lco_floquet:.4f} a cycle, beside the trivial 1")
    table.add_row("participation [%]", "  ".join(f"{p:.1f}" for p in facts.participation_percent[:8]))
    table.add_row("largest |w|/h at the end", f"{facts.end_amplitude_over_h:.4f}")
    table.add_row("peak voltage", f"{facts.peak_voltage_v:.1f} V")
    table.add_row("saturated", f"{100 * facts.saturated_share:.1f} % of the time under control")
    table.add_row("growth, uncontrolled", f"{facts.open_loop_growth_per_s:+.2f} /s")
    table.add_row("growth, controlled", f"{facts.closed_loop_growth_per_s:+.2f} /s")
    OUT.print(table)
    if cycles and not facts.cycles:
        OUT.print("no stable limit cycle was found from any start")
    for k, cycle in enumerate(facts.cycles):
        kind = "symmetric" if cycle.symmetric else f"one of a pair, half range {cycle.half_range_over_h:.4f}"
        others = sorted(cycle.floquet_modulus, key=lambda size: abs(size - 1))[1:]
        size, hertz = f"w/h = {cycle.amplitude_over_h:.4f}", f"{cycle.frequency_hz:.2f} Hz"
        OUT.print(f"cycle {k + 1}: {size}, {hertz}, {kind}, Floquet multipliers 1 and up to {max(others):.4f}")
    if facts.estimate is not None:
        print_estimate(facts.estimate)
    if facts.full_order is not None:
        full = facts.full_order
        table = Table(title="full-order model", show_header=False)
        table.add_row("damping time", number(full.damping_time_s, ".4f s", "–"))
        table.add_row("limit cycle, w/h at 0.75 a", number(full.lco_amplitude_over_h, ".4f", "–"))
        table.add_row("limit cycle frequency", number(full.lco_frequency_hz, ".2f Hz", "–"))
        table.add_row("peak voltage", f"{full.peak_voltage_v:.1f} V")
        OUT.print(table)


def print_estimate(estimate: ErrorEstimate) -> None:
    """Show how far the figures may be off."""
    mesh = "x".join(str(n) for n in estimate.finer_mesh or ())
    if estimate.damps_in_richer is False:
        warn(["the controller does not damp the richer model: it excites motion that its own modes do not see"])
    table = Table("figure", "value", f"± by {estimate.richer_modes} modes", f"± by mesh {mesh}", title="how sure")
    rows = (
        ("λ_cr", estimate.lambda_cr, ".2f"),
        ("limit cycle, w/h at 0.75 a", estimate.lco_amplitude_over_h, ".4f"),
        ("damping time", estimate.damping_time_s, ".4f s"),
    )
    for name, row, form in rows:
        if row is not None:
            table.add_row(name, *(number(v, form, "–") for v in (row.value, row.basis_error, row.mesh_error)))
    OUT.print(table)


def print_authority(design: Design, shown: AuthorityMap) -> None:
    """Show the authority of every element, rows downstream."""
    pressure = Stream.of(design).dynamic_pressure
    size = float(np.nanmax(np.abs(shown.values), initial=0.0))
    power = 3 * int(np.floor(np.log10(size) / 3)) if size > 0 else 0
    unit = f"1e{power} {shown.unit}" if power else shown.unit
    title = f"{shown.title} [{unit}], rows downstream, λ = {pressure:g}; {shown.better} is better"
    table = Table(title=title, box=None)
    for j in range(design.mesh.ny):
        table.add_column(f"j = {j}", justify="right")
    for row in shown.values.reshape(design.mesh.nx, design.mesh.ny) / 10.0**power:
        table.add_row(*("–" if np.isnan(value) else f"{value:.4g}" for value in row))
    OUT.print(table)
    if np.isnan(shown.values).any():
        OUT.print(f"–: {shown.note}", highlight=False)
    OUT.print("best: " + "  ".join(str(element) for element in shown.best[:10]), highlight=False)


def print_control(facts: ControlFacts) -> None:
    """Show the facts of a closed loop."""
    count = len(facts.channels)
    title = f"{facts.controller} on {count} channel{'' if count == 1 else 's'} at λ = {facts.dynamic_pressure:g}"
    table = Table(title=title, show_header=False)
    table.add_row("λ_cr with patches", number(facts.lambda_cr, ".2f", "none") + (", passive" if facts.passive else ""))
    table.add_row("growth, uncontrolled", f"{facts.open_loop_growth_per_s:+.2f} /s")
    table.add_row("growth, controlled", f"{facts.closed_loop_growth_per_s:+.2f} /s")
    margin = f"{facts.growth_at_lower_per_s:+.2f} /s and {facts.growth_at_higher_per_s:+.2f} /s"
    table.add_row("the same with λ 10 % lower, higher", margin + ("" if facts.stands_model_error else ": not stable"))
    poles = zip(facts.pole_growth_per_s[:4], facts.pole_frequency_hz[:4], strict=True)
    table.add_row("leading poles", "  ".join(f"{growth:+.1f} /s at {hertz:.0f} Hz" for growth, hertz in poles))
    table.add_row("stabilises up to λ", _limit(facts.stabilises_up_to, facts.stabilises_beyond))
    table.add_row("ends the limit cycle up to λ", _limit(facts.suppresses_up_to, facts.suppresses_beyond))
    table.add_row("damping time, seed protocol", number(facts.damping_time_s, ".4f s", "–"))
    table.add_row("worst over phases", number(facts.robust_damping_time_s, ".4f s", "–"))
    table.add_row("mean over phases", number(facts.mean_damping_time_s, ".4f s", "–"))
    times = facts.phase_damping_times_s
    if times:
        table.add_row("from each phase", "  ".join(number(time, ".4f", "never") for time in times))
    table.add_row("control energy ∫V² dt", f"{facts.control_energy_v2s:.4g} V²·s")
    table.add_row("work of the patches on the panel", f"{facts.drive_work_j:+.4g} J")
    table.add_row("largest |w|/h at the end", f"{facts.end_amplitude_over_h:.4f}")
    table.add_row("peak voltage", f"{facts.peak_voltage_v:.1f} V")
    table.add_row("saturated", f"{100 * facts.saturated_share:.1f} % of the time under control")
    OUT.print(table)


def print_hold(own: float, rows: list[HoldRow]) -> None:
    """Show what a layout does over λ: with a controller made for each, and with that of its own λ."""
    table = Table(title=f"controller made for each λ, and kept from λ = {own:g}")
    heads = ("λ", "state", "growth [1/s]", "controlled", "damping [s]", "worst", "mean", "peak [V]")
    for head in (*heads, "kept: growth", "worst"):
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(
            f"{row.dynamic_pressure:g}",
            row.state,
            f"{row.open_loop_growth_per_s:+.1f}",
            number(row.closed_loop_growth_per_s, "+.1f", "none"),
            number(row.damping_time_s, ".4f", "–"),
            number(row.robust_damping_time_s, ".4f", "–"),
            number(row.mean_damping_time_s, ".4f", "–"),
            number(row.peak_voltage_v, ".1f", "–"),
            number(row.fixed_closed_loop_growth_per_s, "+.1f", "none"),
            number(row.fixed_robust_damping_time_s, ".4f", "–"),
        )
    OUT.print(table)
    fluttering = [row.state for row in rows if "suppressed" in row.state]
    good, part = fluttering.count("suppressed"), fluttering.count("suppressed in part")
    rest = f", in part at {part} (a motion out of reach grows)" if part else ""
    OUT.print(f"suppressed at {good} of the {len(fluttering)} λ with a limit cycle{rest}", highlight=False)


def _limit(value: float | None, beyond: bool) -> str:
    """A limit in λ."""
    if value is None:
        return "–"
    return f"{value:.1f}{' and beyond' if beyond else ''}" if value else "none"


def number(value: float | None, form: str, missing: str) -> str:
    """A number in a format, its unit after a blank, or what stands for a missing one."""
    if value is None:
        return missing
    digits, _, unit = form.partition(" ")
    return f"{value:{digits}} {unit}".rstrip()
