"""Owns the reading of command-line words: options of a command, the DESIGN it names, and overrides of its fields."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from dataclasses import field, make_dataclass
from typing import Annotated, Any, Protocol, TypeVar

import msgspec
import tyro

from solver import Design, DesignError, load_design

DesignName = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="DESIGN", help="A preset, a JSON file, or ranking.json#2."),
]
JsonFlag = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Print one JSON object on stdout.")]


class NamesDesign(Protocol):
    """Options of a command that works on a design."""

    @property
    def design(self) -> str:
        """A preset's name or a file."""
        ...


Options = TypeVar("Options")
OnDesign = TypeVar("OnDesign", bound=NamesDesign)


def parsed(options: type[Options], words: Sequence[str], command: str) -> Options:
    """The options of a command from its words.

    Raises:
        DesignError: the words make no sense; one line says which.
        SystemExit: help was asked for, and has been printed.
    """
    return _read(options, words, command)


def parsed_on_design(options: type[OnDesign], words: Sequence[str], command: str) -> tuple[OnDesign, Design]:
    """The options of a command, and the design it names with the fields that the words override.

    The words are read twice: first for the design's name, then with that design's fields for defaults, so that an
    override may stand before the name and the help shows what would be used.

    Raises:
        DesignError: as `parsed`, or the design cannot be used.
        SystemExit: help was asked for, and has been printed.
    """
    asking = {"-h", "--help"} & set(words)
    name = options_of(_read(_with_fields(options, Design()), words, command)).design if not asking else None
    values = _read(_with_fields(options, load_design(name) if name else Design()), words, command)
    parts = {part: getattr(values, part) for part in _parts()}
    return options_of(values), Design(**parts)


def options_of(values: Any) -> Any:  # noqa: ANN401 - the class is made at run time
    """The command's own options among the values read."""
    return values.options


def _parts() -> list[str]:
    return [part.name for part in msgspec.structs.fields(Design) if part.name != "schema_version"]


def _with_fields(options: type, design: Design) -> type:
    """A class for tyro: the options, and every part of the design with its present values for defaults."""
    parts = [(name, type(getattr(design, name)), field(default=getattr(design, name))) for name in _parts()]
    own = ("options", Annotated[options, tyro.conf.OmitArgPrefixes])
    made = make_dataclass("Command", [own, *parts], frozen=True)
    made.__doc__ = options.__doc__
    return made


def _read(kind: type[Options], words: Sequence[str], command: str) -> Options:
    program = f"flutterviz {command}"
    if {"-h", "--help"} & set(words):
        return tyro.cli(kind, args=words, prog=program)
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            # help is not asked for, and to look for it in the source files takes half of the time
            return tyro.cli(kind, args=words, prog=program, config=(tyro.conf.HelptextFromCommentsOff,))
    except SystemExit:
        raise DesignError(f"{_one_line(said.getvalue())} ({program} --help lists the options)") from None


def _one_line(said: str) -> str:
    """What tyro says under its title and between two rules, as one line; the nearest known option beside it."""
    sections = [" ".join(part.split()) for part in re.split(r"^\s*[-─]{8,}\s*$", said, flags=re.MULTILINE)]
    line = re.sub(
        r"^Error parsing (?:options\.task: )?(?=\S+( = .*)?: )", "", sections[1] if len(sections) > 1 else sections[0]
    )
    near = re.search(r"Perhaps you meant: (--[\w.-]+)", " ".join(sections))
    return f"{line}; perhaps you meant {near[1]}" if near else line
