"""Owns the building of rigs beside the loop: one at a time, in another process, for the design that is wanted."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass

from flutterviz.parcel import packed, unpacked
from flutterviz.rig import Rig, in_flutter, rig_of, same_panel, same_structure
from solver import Design
from solver.mesh import Floats

TRIES = 2  # at a rig whose process is ended from outside, as where memory is short


@dataclass(frozen=True)
class Built:
    """A rig that is ready to be swapped in."""

    rig: Rig
    """The rig."""
    start: Floats | None
    """(2n,) state to begin with in full flutter, on another mesh or panel than before; None to go on from the last
    [m·√kg, and a second]."""


class Builder:
    """Builds a rig while the last one runs on; nothing in it waits, but `close`.

    A rig for other patches is given out before its λ_cr is known, which the motion does not need and words can wait
    for: that is computed next, and put in.
    """

    def __init__(self, executor: Executor, ready: Callable[[], None]) -> None:
        """Build by an executor; `ready` is called, from another thread, when there is something to take."""
        self._executor = executor
        self._ready = ready
        self._work: Future[tuple[bytes, Floats | None]] | None = None
        self._known: Rig | None = None
        self._completing: tuple[Rig, Future[tuple[float, float] | None]] | None = None
        self._losses = 0
        self.design: Design | None = None
        """What is being built, or was last."""

    @property
    def busy(self) -> bool:
        """Whether a rig is under way, or waits to be taken."""
        return self._work is not None

    @property
    def completing(self) -> bool:
        """Whether λ_cr of the rig taken last is on its way."""
        return self._completing is not None

    def prepare(self, design: Design) -> None:
        """Let the executor import and compile what it needs, by building a rig that nobody waits for.

        Raises:
            OSError: no process can be begun.
        """
        self._executor.submit(_build, design, None, None)

    def begin(self, design: Design, last: Rig) -> None:
        """Build a design's rig, which follows the last one.

        Raises:
            OSError: no process can be begun.
        """
        self.design = design
        self._known = last if same_structure(design, last.design) else None
        parcel = packed(last) if self._known is not None else None
        self._work = self._executor.submit(_build, design, parcel, last.design)
        self._work.add_done_callback(self._tell)

    def taken(self) -> Built | None:
        """The rig, once it is ready.

        Raises:
            DesignError: the design cannot be simulated.
            OSError: the process was ended, time and again.
        """
        self._complete()
        if self._work is None or not self._work.done():
            return None
        done, self._work = self._work, None
        try:
            parcel, start = done.result()
        except BrokenExecutor:
            self._losses += 1
            if self._losses < TRIES:
                return None  # it will be asked for again
            self._losses = 0
            raise OSError("the process that was building it was ended from outside; is memory short?") from None
        self._losses = 0
        rig = unpacked(parcel, self._known)
        if not rig.complete:
            with contextlib.suppress(OSError):  # whoever asks for λ_cr then waits for it
                self._completing = rig, self._executor.submit(_critical, parcel)
                self._completing[1].add_done_callback(self._tell)
        return Built(rig, start)

    def close(self) -> None:
        """End the work under way."""
        self._executor.shutdown(wait=True, cancel_futures=True)

    def _complete(self) -> None:
        if self._completing is not None and self._completing[1].done():
            (rig, done), self._completing = self._completing, None
            if not done.exception():
                rig.complete_with(done.result())

    def _tell(self, _: object) -> None:
        self._ready()


# --- in the other process ---------------------------------------------------------------------------------------------


def _build(design: Design, parcel: bytes | None, before: Design | None) -> tuple[bytes, Floats | None]:
    """A rig as a parcel, and the state that it begins with where it does not go on from the one before."""
    last = unpacked(parcel) if parcel is not None else None
    rig = rig_of(design, last, complete=last is not None)
    start = None if before is None or same_panel(design, before) else in_flutter(rig)
    return packed(rig, last), start


def _critical(parcel: bytes) -> tuple[float, float] | None:
    """λ_cr and the flutter frequency of a rig that was built here."""
    return unpacked(parcel).plant.critical
