"""Owns the reading and writing of Designs as JSON, from files and from the presets that come with the package."""

from __future__ import annotations

from pathlib import Path

import msgspec

from solver.design import Design
from solver.errors import DesignError

_HERE = Path(__file__).resolve().parent
# A wheel carries the presets inside the package; a checkout has them where people look for them.
_PRESETS = next((p for p in (_HERE / "presets", _HERE.parent / "assets" / "presets") if p.is_dir()), _HERE / "presets")


def preset_names() -> list[str]:
    """Names of the presets, sorted."""
    return sorted(path.stem for path in _PRESETS.glob("*.json"))


def design_to_json(design: Design) -> str:
    """The design as indented JSON that `design_from_json` reads back to an equal value."""
    return msgspec.json.format(msgspec.json.encode(design), indent=2).decode() + "\n"


def design_from_json(text: str | bytes, source: str = "design") -> Design:
    """Read a design from JSON; absent fields take their defaults.

    Raises:
        DesignError: not JSON, truncated, a field unknown or of the wrong type, or a value out of range.
    """
    try:
        return msgspec.json.decode(text, type=Design)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:  # a ValidationError is a DecodeError
        cut = "; the file is cut off: save it again" if "truncated" in str(error) else ""
        raise DesignError(f"{source}: {' '.join(str(error).split())}{cut}") from None


def load_design(name: str) -> Design:
    """Load a design by a preset's name or a file's path; of a ranking the best, or with FILE#RANK that one.

    Raises:
        DesignError: there is no such preset or file, or it does not hold a design.
    """
    if name in preset_names():
        return design_from_json((_PRESETS / f"{name}.json").read_bytes(), name)
    path, rank = Path(name), 1
    before, mark, number = name.rpartition("#")
    if mark and number.isdigit() and not path.exists():
        path, rank = Path(before), int(number)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        known = ", ".join(preset_names())
        raise DesignError(f"{name}: no such preset or file; presets are {known}") from None
    except OSError as error:
        raise DesignError(f"{name}: cannot be read ({error.strerror})") from None
    if _Places.in_file(data):
        return _Places.design(data, name, rank)
    return design_from_json(data, name)


class _Places(msgspec.Struct, frozen=True):
    """The ranking in a search's file; all else in it is not looked at."""

    search_version: int
    ranking: list[_Place]

    @staticmethod
    def in_file(data: bytes) -> bool:
        """Whether a file looks like a search's."""
        return b'"search_version"' in data and b'"ranking"' in data

    @staticmethod
    def design(data: bytes, name: str, rank: int) -> Design:
        """The design at a rank, from 1 on."""
        try:
            places = msgspec.json.decode(data, type=_Places).ranking
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise DesignError(f"{name}: {' '.join(str(error).split())}") from None
        if not 1 <= rank <= len(places):
            raise DesignError(f"{name}: there is no rank {rank}; the ranking has {len(places)} layouts")
        return places[rank - 1].design


class _Place(msgspec.Struct, frozen=True):
    """A place in a ranking."""

    design: Design


def save_design(design: Design, path: Path) -> None:
    """Write the design as JSON, whole or not at all.

    Raises:
        OSError: the file cannot be written.
    """
    draft = path.with_name(path.name + ".part")
    draft.write_text(design_to_json(design), encoding="utf-8")
    draft.replace(path)
