"""Owns the file that a ranking is kept in, and the journal beside it by which a search that was killed goes on."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO

import msgspec

from solver.design import Design
from solver.errors import DesignError
from solver.ranking import Ranking
from solver.score import LINEAR, Score
from solver.task import Task

SCHEMA_VERSION = 1


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a search was for."""

    design: Design
    """What was searched on."""
    task: Task
    """What was looked for."""
    search_version: int = SCHEMA_VERSION
    """Version of this file format."""


class RankedDesign(msgspec.Struct, frozen=True):
    """A place in a ranking."""

    rank: int
    """From 1 on."""
    design: Design
    """The design, ready to be run."""
    figures: Score
    """What was found of it."""


class RankingFile(msgspec.Struct, frozen=True):
    """A ranking as it is saved."""

    design: Design
    """What was searched on."""
    task: Task
    """What was looked for."""
    complete: bool
    """Whether the search came to its end; if not, the same command goes on with it."""
    evaluated: int
    """How many layouts were looked at."""
    measured: int
    """How many of them were run in full, or until a bound cut them short."""
    reference: Score | None
    """What the elements of highest NFCG give."""
    ranking: list[RankedDesign]
    """The best first, as many as the task's `top`."""
    front: list[RankedDesign]
    """What none beats in both objective and number of elements, the fewest elements first."""
    passive: list[RankedDesign]
    """Layouts that end the flutter passively, the fewest elements first, as many as `top`."""
    scores: list[Score]
    """Every layout that was looked at, the fewest elements first."""
    search_version: int = SCHEMA_VERSION
    """Version of this file format."""


def file_of(ranking: Ranking) -> RankingFile:
    """A ranking as it is saved."""

    def designs(found: tuple[Score, ...]) -> list[RankedDesign]:
        return [RankedDesign(k + 1, ranking.design_of(score), score) for k, score in enumerate(found)]

    top = ranking.task.top
    return RankingFile(
        design=ranking.design,
        task=ranking.task,
        complete=ranking.complete,
        evaluated=ranking.evaluated,
        measured=ranking.measured,
        reference=ranking.reference,
        ranking=designs(ranking.ranked[:top]),
        front=designs(ranking.front),
        passive=designs(ranking.passive[:top]),
        scores=list(ranking.scores),
    )


def read_ranking(path: Path) -> RankingFile:
    """Read a ranking.

    Raises:
        DesignError: there is none in the file, or it is of another version.
    """
    try:
        found = msgspec.json.decode(path.read_bytes(), type=RankingFile)
    except OSError as error:
        raise DesignError(f"{path}: cannot be read ({error.strerror})") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DesignError(f"{path}: is not the ranking of a search ({' '.join(str(error).split())})") from None
    if found.search_version != SCHEMA_VERSION:
        raise DesignError(f"{path}: search_version = {found.search_version}: this version reads {SCHEMA_VERSION}")
    return found


class Journal:
    """The scores of a search on disk, each from the moment it is known: FILE.journal until the end, then FILE."""

    def __init__(self, path: Path, design: Design, task: Task) -> None:
        """Begin, or go on with what an earlier search for the same left.

        Args:
            path: the ranking's file.
            design: what is searched on.
            task: what is looked for, as `task_for` gives it.

        Raises:
            DesignError: the file is something else, or of another search, or is damaged.
            OSError: it cannot be written.
        """
        if path.is_dir() or not path.absolute().parent.is_dir():
            raise DesignError(f"{path}: give a file in a folder that exists")
        if not os.access(path.absolute().parent, os.W_OK):
            raise DesignError(f"{path}: the folder cannot be written to")
        self.path, self._log = path, path.with_name(path.name + ".journal")
        self._header = Header(design, task)
        self._scores: dict[tuple[int, ...], Score] = {}
        self._file: IO[bytes] | None = None
        if path.exists():
            saved = read_ranking(path)
            _refuse_other(path, Header(saved.design, saved.task), design, task)
            if task.evaluations is not None and task.evaluations < saved.evaluated:
                count = f"{saved.evaluated} layouts, more than evaluations = {task.evaluations}"
                raise DesignError(f"{path}: holds {count}; choose another file")
            self._scores.update({score.elements: score for score in saved.scores})
        if self._log.exists():
            header, scores = _read_log(self._log)
            if header is not None:
                _refuse_other(self._log, header, design, task)
            self._scores.update({score.elements: score for score in scores})
        self.known = list(self._scores.values())

    def add(self, score: Score) -> None:
        """Keep a score, unless as much was known."""
        old = self._scores.get(score.elements)
        if old is not None and self._told(old) >= self._told(score):
            return
        file = self._file or self._begun()
        self._scores[score.elements] = score
        file.write(msgspec.json.encode(score) + b"\n")
        file.flush()

    def close(self, ranking: Ranking | None) -> None:
        """Write the ranking, as far as it has come, and take the journal away; without one, the journal stays."""
        if self._file is not None:
            self._file.close()
        if ranking is not None:
            encoded = msgspec.json.encode(file_of(ranking))
            _replace(self.path, msgspec.json.format(encoded, indent=1) + b"\n")
            self._log.unlink(missing_ok=True)

    def _told(self, score: Score) -> tuple[int, float]:
        """How much a score tells: linear figures, that a layout is worse than a bound, or all."""
        if score.state in LINEAR:
            return 0, 0.0
        return (2, 0.0) if score.bound is None else (1, self._header.task.cost(score.bound))

    def _begun(self) -> IO[bytes]:
        """The journal, written anew with what is known: a last line that was cut off is gone."""
        _replace(self._log, b"".join(msgspec.json.encode(line) + b"\n" for line in (self._header, *self.known)))
        self._file = self._log.open("ab")
        return self._file


def _replace(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    draft = path.with_name(path.name + ".part")
    draft.write_bytes(content)
    draft.replace(path)


def _refuse_other(path: Path, header: Header, design: Design, task: Task) -> None:
    """Refuse to mix two searches; a search may go on for longer than it was first allowed."""
    if header.design.with_elements(()) != design.with_elements(()):
        raise DesignError(f"{path}: holds a search on another design; choose another file, or remove it")
    for name in Task.__struct_fields__:
        there, here = getattr(header.task, name), getattr(task, name)
        if there != here and name != "evaluations":
            raise DesignError(
                f"{path}: holds a search with {name} = {there}, not {here}; choose another file, or remove it"
            )


def _read_log(path: Path) -> tuple[Header | None, list[Score]]:
    """Header and scores of a journal; a last line that was cut off does not count."""
    lines = path.read_bytes().split(b"\n")
    header, scores = None, []
    for number, line in enumerate(lines[:-1]):  # what follows the last line's end is empty, or was cut off
        try:
            if number == 0:
                header = msgspec.json.decode(line, type=Header)
            else:
                scores.append(msgspec.json.decode(line, type=Score))
        except (msgspec.DecodeError, UnicodeDecodeError):
            raise DesignError(f"{path}: line {number + 1} is damaged; remove the file to begin anew") from None
    return header, scores
