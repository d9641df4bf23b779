"""Owns the command line: its commands, what they print, and every error of a user as one line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from flutterviz.arguments import parsed, parsed_on_design
from solver import ControlError, Design, FlutterFacts, RunFacts, flutter_facts, nfcg, run_facts
from solver.mesh import Floats

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
    json: JsonFlag = False


@dataclass(frozen=True)
class Simulate:
    """Run the seed protocol: flutter from a small start, then the controller."""

    design: DesignName
    save: Path | None = None
    """Write the run to a file, .npz, .csv, .rrd or .glb by its ending."""
    json: JsonFlag = False


@dataclass(frozen=True)
class Nfcg:
    """Norm of the feedback control gain of every element: where patches have authority."""

    design: DesignName
    json: JsonFlag = False


@dataclass(frozen=True)
class Check:
    """Run the validation table on this machine; exits with 1 if a case misses."""

    json: JsonFlag = False


@dataclass(frozen=True)
class Replay:
    """Open a recording in rerun's viewer."""

    file: RrdFile


COMMANDS = {"view": View, "flutter": Flutter, "simulate": Simulate, "nfcg": Nfcg, "check": Check, "replay": Replay}

# wide enough for a table's rows where the output goes into a file
OUT, ERR = Console(width=None if sys.stdout.isatty() else 140), Console(stderr=True)


def main() -> None:
    """Run the command line of this process and exit."""
    sys.exit(run(sys.argv[1:]))


def run(words: Sequence[str]) -> int:
    """Run a command line; gives the exit code: 0 done, 1 a check missed, 2 input that cannot be used."""
    try:
        return _dispatch(list(words))
    except (ControlError, OSError, ValueError) as error:  # a DesignError is a ValueError
        line = " ".join(str(error).split())
        ERR.print(f"flutterviz: {line}", style="red", markup=False, highlight=False, soft_wrap=True)
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
            facts = flutter_facts(design)
            _print_json(facts) if options.json else _print_flutter(design, facts)
        case "simulate":
            options, design = parsed_on_design(Simulate, words, name)
            _simulate(options, design)
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


def _simulate(options: Simulate, design: Design) -> None:
    if options.save is not None:
        from flutterviz.export import check_target, save_trace

        check_target(options.save)
        with ERR.status("running the seed protocol"):
            facts, trace = run_facts(design)
        save_trace(trace, options.save)
        ERR.print(f"saved {options.save}", highlight=False, markup=False)
    else:
        with ERR.status("running the seed protocol"):
            facts, _ = run_facts(design)
    _print_json(facts) if options.json else _print_run(design, facts)


def _check(options: Check) -> int:
    from solver.check import run_checks

    cases = []
    with ERR.status("checking") as status:
        for case in run_checks():
            cases.append(case)
            status.update(f"checked {case.name}")
    missed = [case for case in cases if not case.ok]
    if options.json:
        _print_json({"cases": cases})
    else:
        table = Table("case", "ours", "reference", "off by", "tolerance", "paper", "", title="validation")
        for case in cases:
            table.add_row(
                case.name,
                _number(case.value, ".6g", "none"),
                f"{case.reference:.6g}",
                "" if case.value is None else f"{abs(case.value - case.reference) / abs(case.reference or 1):.1e}",
                f"{case.tol:.0e}",
                f"{case.seed:g}" if case.seed is not None else "",
                "ok" if case.ok else "MISS",
                style=None if case.ok else "bold red",
            )
        OUT.print(table)
        OUT.print(f"{len(cases) - len(missed)} of {len(cases)} within tolerance")
    return 1 if missed else 0


def _print_flutter(design: Design, facts: FlutterFacts) -> None:
    count = len(design.patches.elements)
    table = Table(title=f"flutter, C_a = {design.flow.damping:g}, {count} patched elements", show_header=False)
    table.add_row("λ_cr", _number(facts.lambda_cr, ".2f", "none up to λ = 20 000"))
    table.add_row(f"λ_cr in {facts.modes} modes", _number(facts.lambda_cr_in_basis, ".2f", "none up to λ = 20 000"))
    table.add_row("flutter frequency", _number(facts.flutter_frequency_hz, ".2f Hz", "–"))
    table.add_row("natural frequencies [Hz]", "  ".join(f"{f:.1f}" for f in facts.frequencies_hz[:12]))
    OUT.print(table)


def _print_run(design: Design, facts: RunFacts) -> None:
    table = Table(title=f"seed protocol at λ = {design.flow.dynamic_pressure:g}", show_header=False)
    state = "passive" if facts.passive else "flutters" if facts.flutters else "stable"
    table.add_row("state", "diverged" if facts.diverged else state)
    table.add_row("λ_cr with patches", _number(facts.lambda_cr, ".2f", "none"))
    table.add_row(
        "damping time", _number(facts.damping_time_s, ".4f s", "never in this run" if facts.flutters else "–")
    )
    table.add_row("limit cycle, w/h at 0.75 a", _number(facts.lco_amplitude_over_h, ".4f", "–"))
    table.add_row("limit cycle frequency", _number(facts.lco_frequency_hz, ".2f Hz", "–"))
    table.add_row("participation [%]", "  ".join(f"{p:.1f}" for p in facts.participation_percent[:8]))
    table.add_row("peak voltage", f"{facts.peak_voltage_v:.1f} V")
    table.add_row("saturated", f"{100 * facts.saturated_share:.1f} % of the time to damped")
    table.add_row("growth, uncontrolled", f"{facts.open_loop_growth_per_s:+.2f} /s")
    table.add_row("growth, controlled", f"{facts.closed_loop_growth_per_s:+.2f} /s")
    OUT.print(table)


def _print_nfcg(design: Design, norms: Floats) -> None:
    table = Table(title=f"NFCG [1000 V/(m·√kg)], rows downstream, λ = {design.flow.dynamic_pressure:g}", box=None)
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
