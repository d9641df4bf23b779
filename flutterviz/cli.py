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
from rich.table import Table

from flutterviz.arguments import DesignName, JsonFlag, parsed, parsed_on_design
from flutterviz.bench.figure import PartName
from flutterviz.figures import check_picture, draw_roots, draw_sweep
from flutterviz.searching import SearchOptions, run_search
from flutterviz.tables import (
    ERR,
    OUT,
    print_authority,
    print_control,
    print_flutter,
    print_hold,
    print_run,
    print_sweep,
    warn,
)
from flutterviz.validation import markdown, terminal_table, write_into
from solver import (
    ControlError,
    Design,
    DesignError,
    authority,
    control_facts,
    flutter_facts,
    hold_over,
    run_facts,
    sweep,
)
from solver.authority import Criterion

MOST_ROWS = 1000  # of a sweep, each of which takes a second or so
USER_ERROR = 2
"""Exit code for input that cannot be used."""

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
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
class ControlOptions:
    """Facts of the closed loop: poles, damping over phases of the limit cycle, limits in λ, energy, margin."""

    design: DesignName
    over: Annotated[str | None, tyro.conf.arg(metavar="START:STOP:STEP")] = None
    """Hold the layout against these dynamic pressures as well, as 512:1200:43; the last one is included."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Nfcg:
    """Control authority of every element: the norm of its feedback gain, or another criterion."""

    design: DesignName
    criterion: Criterion = "nfcg"
    """nfcg: gain norm of an actuator there; nkfeg: estimator gain norm of a sensor there; controllability: force on the
    growing motion; h2: closed-loop cost with it alone; growth: growth rate by one more patch, uncontrolled."""
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
class Bench:
    """Measure speed on this machine, every figure beside a baseline of the same run; exits with 1 if one is missing."""

    parts: Annotated[tuple[PartName, ...], tyro.conf.Positional] = ()
    """Parts to measure; all unless given."""
    quick: Flag = False
    """Fewer repeats: sooner done, with a wider spread."""
    markdown: Flag = False
    """Print the table as Markdown."""
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
    "control": ControlOptions,
    "nfcg": Nfcg,
    "search": SearchOptions,
    "check": Check,
    "bench": Bench,
    "replay": Replay,
}


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
            _nfcg(options, design)
        case "control":
            options, design = parsed_on_design(ControlOptions, words, name)
            _control(options, design)
        case "search":
            options, design = parsed_on_design(SearchOptions, words, name)
            return run_search(options, design)
        case "check":
            return _check(parsed(Check, words, name))
        case "bench":
            return _bench(parsed(Bench, words, name))
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


def _flutter(options: Flutter, design: Design) -> None:
    if options.plot is not None:
        check_picture(options.plot)
    facts = flutter_facts(design)
    warn(facts.warnings)
    if options.plot is not None:
        draw_roots(facts, options.plot)
        ERR.print(f"saved {options.plot}", highlight=False, markup=False)
    _print_json(facts) if options.json else print_flutter(design, facts)


def _sweep(options: Sweep, design: Design) -> None:
    from rich.progress import Progress  # here, because few commands need it

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
    _print_json({"over": field, "rows": rows}) if options.json else print_sweep(field, rows)


def _nfcg(options: Nfcg, design: Design) -> None:
    shown = authority(design, options.criterion)
    if not options.json:
        print_authority(design, shown)
        return
    values = [float(v) if np.isfinite(v) else None for v in shown.values]
    named = {"nfcg": values} if shown.criterion == "nfcg" else {}
    told = {"criterion": shown.criterion, "unit": shown.unit, "better": shown.better, "values": values}
    _print_json(told | {"best": shown.best} | named)


def _control(options: ControlOptions, design: Design) -> None:
    from rich.progress import Progress  # here, because few commands need it

    pressures = _span(options.over, f"--over {options.over}", "512:1200:43") if options.over else []
    for pressure in pressures:
        design.with_dynamic_pressure(pressure)  # refused before anything is computed
    with ERR.status("closing the loop"):
        facts = control_facts(design)
    warn(facts.warnings)
    if not options.json:
        print_control(facts)
    rows = []
    with Progress(console=ERR, transient=True) as progress:
        task = progress.add_task("λ", total=len(pressures), visible=bool(pressures))
        for row in hold_over(design, pressures) if pressures else ():
            rows.append(row)
            progress.update(task, advance=1, description=f"λ = {row.dynamic_pressure:g}")
    if options.json:
        _print_json(msgspec.to_builtins(facts) | {"rows": rows})
    elif rows:
        print_hold(facts.dynamic_pressure, rows)


def _range(words: str) -> tuple[str, list[float]]:
    """Field and values of FIELD=START:STOP:STEP."""
    field, equals, span = words.partition("=")
    return field, _span(span if equals else "", f"--over {words}", "flow.dynamic-pressure=500:1200:50")


def _span(span: str, option: str, example: str) -> list[float]:
    """Values of START:STOP:STEP."""
    try:
        start, stop, step = (float(part) for part in span.split(":"))
    except ValueError:
        start, stop, step = 0.0, 0.0, 0.0
    count = (stop - start) / step + 1 if step else 0.0
    if not 1 <= count <= MOST_ROWS or not np.isfinite([start, stop, step]).all():
        field = example.rpartition("=")[0] and "FIELD="
        raise DesignError(
            f"{option}: use {field}START:STOP:STEP with START before STOP and at most {MOST_ROWS} values, as {example}"
        )
    # a stop that a whole number of steps reaches, but for rounding, counts
    return [start + step * k for k in range(int(count + 1e-9))]


def _refuse_two_forms(as_markdown: bool, as_json: bool) -> None:
    if as_markdown and as_json:
        raise DesignError("--markdown and --json are two forms of one table: use one of them")


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
    warn(facts.warnings)
    _print_json(facts) if options.json else print_run(facts, options.cycles)


def _check(options: Check) -> int:
    _refuse_two_forms(options.markdown, options.json)
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


def _bench(options: Bench) -> int:
    _refuse_two_forms(options.markdown, options.json)
    from flutterviz.bench.run import run_bench

    return run_bench(options.parts, options.quick, options.markdown, options.json)
