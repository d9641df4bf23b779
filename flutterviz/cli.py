"""Owns the command line: its commands, what they print, and every error of a user as one line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from flutterviz.arguments import parsed, parsed_on_design
from flutterviz.figures import check_picture, draw_roots, draw_sweep
from flutterviz.validation import markdown, terminal_table, write_into
from solver import (
    ControlError,
    Design,
    DesignError,
    ErrorEstimate,
    FlutterFacts,
    RunFacts,
    Stream,
    SweepRow,
    flutter_facts,
    nfcg,
    run_facts,
    sweep,
)
from solver.mesh import Floats

MOST_ROWS = 1000  # of a sweep, each of which takes a second or so
USER_ERROR = 2
"""Exit code for input that cannot be used."""

DesignName = Annotated[
    str, tyro.conf.Positional, tyro.conf.arg(metavar="DESIGN", help="A preset's name or a JSON file.")
]
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
JsonFlag = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Print one JSON object on stdout.")]
RrdFile = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE.rrd", help="A recording.")]


@dataclass(frozen=True)
class View:
    """Open the explorer in the browser."""

    design: DesignName = "seed-840"
    host: str = "127.0.0.1"
    """Address to serve on; any but 127.0.0.1 opens the page to the network, without a password."""
    port: int = 8080
    """Port to serve on; 0 takes any free one."""
    record: Path | None = None
    """Record the run from the start to this rerun file (.rrd)."""
    no_open: Flag = False
    """Do not open a browser window."""


@dataclass(frozen=True)
class Flutter:
    """Modes, critical dynamic pressure and eigenvalues over dynamic pressure."""

    design: DesignName
    plot: Path | None = None
    """Draw V-g diagram and root locus into a picture, .png, .svg or .pdf."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Simulate:
    """Run the seed protocol: flutter from a small start, then the controller."""

    design: DesignName
    save: Path | None = None
    """Write the run to a file, .npz, .csv, .rrd or .glb by its ending."""
    estimate_error: Flag = False
    """Run a richer basis and a finer mesh as well, and say how far off the figures may be."""
    cycles: Flag = False
    """Look for every limit cycle that coexists, from several starts, with Floquet multipliers."""
    full_order: Flag = False
    """Integrate the nonlinear finite-element equations as well, with no modal reduction; takes a minute or so."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Sweep:
    """Growth, limit cycle and damping time along a parameter, upwards and back: data of bifurcation diagrams."""

    design: DesignName
    over: Annotated[str, tyro.conf.arg(metavar="FIELD=START:STOP:STEP")]
    """Field of the design and its values, as flow.dynamic-pressure=500:1200:50; the last one is included."""
    plot: Path | None = None
    """Draw the rows into a picture, .png, .svg or .pdf."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Nfcg:
    """Norm of the feedback control gain of every element: where patches have authority."""

    design: DesignName
    json: JsonFlag = False


@dataclass(frozen=True)
class Check:
    """Run the validation table on this machine; exits with 1 if a case misses."""

    markdown: Flag = False
    """Print the table as Markdown."""
    write: Path | None = None
    """Put the table into a Markdown file, between the marks that README has for it."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Replay:
    """Open a recording in rerun's viewer."""

    file: RrdFile


COMMANDS = {
    "view": View,
    "flutter": Flutter,
    "simulate": Simulate,
    "sweep": Sweep,
    "nfcg": Nfcg,
    "check": Check,
    "replay": Replay,
}

# wide enough for a table's rows where the output goes into a file
OUT, ERR = Console(width=None if sys.stdout.isatty() else 140), Console(stderr=True)


def main() -> None:
    """Run the command line of this process and exit."""
    sys.exit(run(sys.argv[1:]))


def run(words: Sequence[str]) -> int:
    """Run a command line; gives the exit code: 0 done, 1 a check missed, 2 input that cannot be used."""
    try:
        return _dispatch(list(words))
    except (ControlError, OSError, ValueError, ArithmeticError, RuntimeError, MemoryError) as error:
        # a DesignError is a ValueError, and so is a matrix that cannot be solved; ARPACK raises RuntimeErrors
        line = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, (ArithmeticError, RuntimeError, MemoryError)):
            line = f"the computation failed: {line}; try fewer modes, a smaller load or another mesh"
        ERR.print(f"flutterviz: {line}", style="red", markup=False, emoji=False, highlight=False, soft_wrap=True)
        return USER_ERROR
    except KeyboardInterrupt:
        return 130
    except SystemExit as error:  # help was given, or a replay was ended by a signal
        return error.code if isinstance(error.code, int) else 0


def _dispatch(words: list[str]) -> int:
    if words[:1] in (["-h"], ["--help"]):
        _usage()
        return 0
    if words == ["--version"]:
        try:
            print(version("flutterviz"))
        except PackageNotFoundError:
            print("unknown: run from a checkout that is not installed")
        return 0
    # with no command it is the explorer that is wanted, as in `flutterviz my-design.json`
    name = words.pop(0) if words and words[0] in COMMANDS else "view"
    match name:
        case "flutter":
            options, design = parsed_on_design(Flutter, words, name)
            _flutter(options, design)
        case "simulate":
            options, design = parsed_on_design(Simulate, words, name)
            _simulate(options, design)
        case "sweep":
            options, design = parsed_on_design(Sweep, words, name)
            _sweep(options, design)
        case "nfcg":
            options, design = parsed_on_design(Nfcg, words, name)
            norms = nfcg(design)
            _print_json({"nfcg": norms.tolist()}) if options.json else _print_nfcg(design, norms)
        case "check":
            return _check(parsed(Check, words, name))
        case "replay":
            from flutterviz.replay import replay

            return replay(parsed(Replay, words, name).file)
        case _:
            from flutterviz.serve import serve

            options, design = parsed_on_design(View, words, name)
            return serve(design, options.host, options.port, options.record, not options.no_open)
    return 0


def _usage() -> None:
    OUT.print("usage: flutterviz [COMMAND] …        (with no command: view)\n", markup=False, highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    for name, options in COMMANDS.items():
        table.add_row(f"  {name}", str(options.__doc__))
    OUT.print(table)
    OUT.print("\n`flutterviz COMMAND --help` lists a command's options; `flutterviz --version` the version.")


def _print_json(value: object) -> None:
    sys.stdout.write(msgspec.json.encode(value).decode() + "\n")


def _warn(lines: Sequence[str]) -> None:
    for line in lines:
        ERR.print(f"warning: {line}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def _flutter(options: Flutter, design: Design) -> None:
    if options.plot is not None:
        check_picture(options.plot)
    facts = flutter_facts(design)
    _warn(facts.warnings)
    if options.plot is not None:
        draw_roots(facts, options.plot)
        ERR.print(f"saved {options.plot}", highlight=False, markup=False)
    _print_json(facts) if options.json else _print_flutter(design, facts)


def _sweep(options: Sweep, design: Design) -> None:
    field, values = _range(options.over)
    if options.plot is not None:
        check_picture(options.plot)
    rows, found = [], sweep(design, field, values)
    with Progress(console=ERR, transient=True) as progress:
        task = progress.add_task(field, total=2 * len(values) - 1)
        for row in found:
            rows.append(row)
            progress.update(task, advance=1, description=f"{field} = {row.value:g}, {row.direction}")
    if options.plot is not None:
        draw_sweep(rows, field, options.plot)
        ERR.print(f"saved {options.plot}", highlight=False, markup=False)
    _print_json({"over": field, "rows": rows}) if options.json else _print_sweep(field, rows)


def _range(words: str) -> tuple[str, list[float]]:
    """Field and values of FIELD=START:STOP:STEP."""
    field, equals, span = words.partition("=")
    try:
        start, stop, step = (float(part) for part in span.split(":"))
    except ValueError:
        start, stop, step = 0.0, 0.0, 0.0
    count = (stop - start) / step + 1 if step else 0.0
    if not equals or not 1 <= count <= MOST_ROWS or not np.isfinite([start, stop, step]).all():
        raise DesignError(
            f"--over {words}: use FIELD=START:STOP:STEP with START before STOP and at most {MOST_ROWS} values, as "
            "flow.dynamic-pressure=500:1200:50"
        )
    # a stop that a whole number of steps reaches, but for rounding, counts
    return field, [start + step * k for k in range(int(count + 1e-9))]


def _simulate(options: Simulate, design: Design) -> None:
    if options.save is not None:
        from flutterviz.export import check_target, save_trace

        check_target(options.save)
        with ERR.status("running the seed protocol"):
            facts, trace = run_facts(design, options.estimate_error, options.cycles, options.full_order)
        save_trace(trace, options.save)
        ERR.print(f"saved {options.save}", highlight=False, markup=False)
    else:
        with ERR.status("running the seed protocol"):
            facts, _ = run_facts(design, options.estimate_error, options.cycles, options.full_order)
    _warn(facts.warnings)
    _print_json(facts) if options.json else _print_run(facts, options.cycles)


def _check(options: Check) -> int:
    from solver.check import run_checks

    cases = []
    with ERR.status("checking") as status:
        for case in run_checks():
            cases.append(case)
            status.update(f"checked {case.name}")
    missed = [case for case in cases if not case.ok]
    if options.write is not None:
        write_into(options.write, cases)
        ERR.print(f"table written into {options.write}", highlight=False, markup=False)
    if options.json:
        _print_json({"cases": cases})
    elif options.markdown:
        sys.stdout.write(markdown(cases))
    else:
        OUT.print(terminal_table(cases))
        OUT.print(f"{len(cases) - len(missed)} of {len(cases)} within tolerance")
    return 1 if missed else 0


def _print_flutter(design: Design, facts: FlutterFacts) -> None:
    count = len(design.patches.elements)
    table = Table(title=f"flutter, C_a = {facts.aerodynamic_damping:.4g}, {count} patched elements", show_header=False)
    name = "λ_cr of the flat state" if facts.buckled else "λ_cr"
    table.add_row(name, _number(facts.lambda_cr, ".2f", "none up to λ = 20 000"))
    table.add_row(f"λ_cr in {facts.modes} modes", _number(facts.lambda_cr_in_basis, ".2f", "none up to λ = 20 000"))
    table.add_row("flutter frequency", _number(facts.flutter_frequency_hz, ".2f Hz", "–"))
    table.add_row("q/β at λ_cr", _number(facts.pressure_cr_pa, ".1f Pa", "–"))
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


def _print_sweep(field: str, rows: list[SweepRow]) -> None:
    table = Table(title=f"sweep over {field}, upwards and back")
    for head in (field, "", "growth [1/s]", "motion", "limit cycle w/h", "[Hz]", "Floquet", "damping time [s]", "λ_cr"):
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(
            f"{row.value:g}",
            row.direction,
            f"{row.growth_per_s:+.2f}",
            f"{row.motion or '–'}{', snapping' if row.snap_through else ''}",
            _number(row.lco_amplitude_over_h, ".4f", "–")
            + (" ?" if row.lco_amplitude_over_h and not row.lco_converged else ""),
            _number(row.lco_frequency_hz, ".2f", "–"),
            _number(row.floquet, ".4f", "–"),
            "passive" if row.passive else _number(row.damping_time_s, ".4f", "–"),
            _number(row.lambda_cr, ".2f", "none"),
        )
    OUT.print(table)


def _print_run(facts: RunFacts, cycles: bool) -> None:
    table = Table(title=f"seed protocol at λ = {facts.dynamic_pressure:g}", show_header=False)
    resting = facts.motion if facts.motion in ("buckled", "deflected") else None
    state = resting or ("passive" if facts.passive else "flutters" if facts.flutters else "stable")
    table.add_row("state", "diverged" if facts.diverged else state)
    table.add_row("λ_cr with patches", _number(facts.lambda_cr, ".2f", "none"))
    table.add_row(
        "damping time", _number(facts.damping_time_s, ".4f s", "never in this run" if facts.flutters else "–")
    )
    if facts.motion is not None:
        chaos = f", Lyapunov exponent {facts.lyapunov_per_s:+.1f} /s" if facts.motion == "chaotic" else ""
        table.add_row("settles into", facts.motion + (", snapping through" if facts.snap_through else "") + chaos)
        if facts.lco_amplitude_over_h is None and facts.motion_amplitude_over_h:
            table.add_row("peak of it, w/h at 0.75 a", f"{facts.motion_amplitude_over_h:.4f}")
    table.add_row("limit cycle, w/h at 0.75 a", _number(facts.lco_amplitude_over_h, ".4f", "–"))
    table.add_row("limit cycle frequency", _number(facts.lco_frequency_hz, ".2f Hz", "–"))
    if facts.lco_floquet is not None:
        table.add_row("Floquet multiplier", f"{facts.lco_floquet:.4f} a cycle, beside the trivial 1")
    table.add_row("participation [%]", "  ".join(f"{p:.1f}" for p in facts.participation_percent[:8]))
    table.add_row("peak voltage", f"{facts.peak_voltage_v:.1f} V")
    table.add_row("saturated", f"{100 * facts.saturated_share:.1f} % of the time to damped")
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
        _print_estimate(facts.estimate)
    if facts.full_order is not None:
        full = facts.full_order
        table = Table(title="full-order model", show_header=False)
        table.add_row("damping time", _number(full.damping_time_s, ".4f s", "–"))
        table.add_row("limit cycle, w/h at 0.75 a", _number(full.lco_amplitude_over_h, ".4f", "–"))
        table.add_row("limit cycle frequency", _number(full.lco_frequency_hz, ".2f Hz", "–"))
        table.add_row("peak voltage", f"{full.peak_voltage_v:.1f} V")
        OUT.print(table)


def _print_estimate(estimate: ErrorEstimate) -> None:
    mesh = "x".join(str(n) for n in estimate.finer_mesh or ())
    if estimate.damps_in_richer is False:
        _warn(["the controller does not damp the richer model: it excites motion that its own modes do not see"])
    table = Table("figure", "value", f"± by {estimate.richer_modes} modes", f"± by mesh {mesh}", title="how sure")
    rows = (
        ("λ_cr", estimate.lambda_cr, ".2f"),
        ("limit cycle, w/h at 0.75 a", estimate.lco_amplitude_over_h, ".4f"),
        ("damping time", estimate.damping_time_s, ".4f s"),
    )
    for name, row, form in rows:
        if row is not None:
            table.add_row(name, *(_number(v, form, "–") for v in (row.value, row.basis_error, row.mesh_error)))
    OUT.print(table)


def _print_nfcg(design: Design, norms: Floats) -> None:
    table = Table(title=f"NFCG [1000 V/(m·√kg)], rows downstream, λ = {Stream.of(design).dynamic_pressure:g}", box=None)
    for j in range(design.mesh.ny):
        table.add_column(f"j = {j}", justify="right")
    for i in range(design.mesh.nx):
        table.add_row(*(f"{norms[i * design.mesh.ny + j] / 1000:.1f}" for j in range(design.mesh.ny)))
    OUT.print(table)


def _number(value: float | None, form: str, missing: str) -> str:
    if value is None:
        return missing
    digits, _, unit = form.partition(" ")
    return f"{value:{digits}} {unit}".rstrip()
