"""Owns what is computed beside the loop about the rig that runs: its outlook, and the authority map asked for."""

from __future__ import annotations

import contextlib
import time
from concurrent.futures import Executor, Future

import msgspec

from flutterviz.outlook import Outlook, outlook_of
from flutterviz.parcel import packed, unpacked
from flutterviz.rig import Rig
from solver import Design
from solver.authority import AuthorityMap, Criterion, authority

PATIENCE = 0.7  # s that a rig must stand before one looks ahead for it: who toggles patches gets all of the machine


class Background:
    """Outlook and authority map of the present rig, each a little late."""

    def __init__(self, executor: Executor) -> None:
        """Begin with nothing to do; an executor is to do it, of another process, or it would hold up the loop."""
        self._executor = executor
        self.outlook: Outlook | None = None
        self.criterion: Criterion | None = None
        self.map: AuthorityMap | None = None
        self.trouble = ""
        self._looking: Future[Outlook] | None = None
        self._looked: Design | None = None
        self._present: Design | None = None
        self._since = 0.0
        self._mapping: Future[AuthorityMap] | None = None
        self._mapped: tuple[object, ...] | None = None

    def ask(self, criterion: Criterion | None) -> None:
        """Ask for the map of a criterion, or for none."""
        self.criterion, self.map, self.trouble, self._mapped = criterion, None, "", None

    def follow(self, rig: Rig) -> None:
        """Take up what is ready and set to work on what a rig lacks; never waits, and never raises.

        What fails is tried again only for another design: the outlook stays unknown, and a map says why there is none.
        """
        self._follow_outlook(rig)
        self._follow_map(rig.design)

    def _follow_outlook(self, rig: Rig) -> None:
        if self._looking is not None and self._looking.done():
            done, self._looking = self._looking, None
            self.outlook = None if done.exception() else done.result()
        if self.outlook is not None and self.outlook.design != rig.design:
            self.outlook = self._looked = None  # should that design come back, as by undo, it is looked at again
        if self._present != rig.design:
            self._present, self._since = rig.design, time.perf_counter()
        rests = time.perf_counter() - self._since > PATIENCE
        if self._looking is None and self._looked != rig.design and rests:
            self._looked = rig.design
            with contextlib.suppress(OSError):  # no process can be begun: nothing is known then
                self._looking = self._executor.submit(_look, packed(rig))

    def _follow_map(self, design: Design) -> None:
        if self._mapping is not None and self._mapping.done():
            done, self._mapping = self._mapping, None
            error = done.exception()
            if self._mapped is not None:  # or it was for a criterion that is no longer asked for
                self.trouble = f"{type(error).__name__}: {' '.join(str(error).split())}" if error else ""
                self.map = None if error else done.result()
        wanted = None if self.criterion is None else (self.criterion, *map_basis(design, self.criterion))
        if wanted != self._mapped and self._mapping is None:
            self._mapped = wanted
            try:
                if self.criterion is not None:
                    self._mapping = self._executor.submit(authority, design, self.criterion)
            except OSError as error:
                self.trouble = str(error)
        if self.map is not None and self.map.criterion != self.criterion:
            self.map = None

    def close(self) -> None:
        """End the work under way."""
        self._executor.shutdown(wait=True, cancel_futures=True)


def _look(parcel: bytes) -> Outlook:
    """The outlook of a rig that comes as a parcel."""
    return outlook_of(unpacked(parcel))


def map_basis(design: Design, criterion: Criterion) -> tuple[object, ...]:
    """The parts of a design that a map depends on: of the patches all but the wiring, of the controller the weights."""
    panel = (design.panel, design.mesh, design.flow, design.load, design.reduction)
    patches, control = design.patches, design.control
    if criterion == "growth":
        return *panel, msgspec.structs.replace(patches, channels="connected")
    weights = (control.weighting, control.state_weight, control.diagonal, control.effort_weight)
    wiring_aside = msgspec.structs.replace(patches, channels="connected", elements=())
    return *panel, wiring_aside, weights, control.observer_weight
