"""Owns how a rig travels between processes: as little of it as the other side lacks."""

from __future__ import annotations

import copyreg
import io
import pickle

from flutterviz.rig import Rig
from solver.assembly import Space, space_of


def packed(rig: Rig, known: Rig | None = None) -> bytes:
    """A rig as bytes. What it has in common with one that the receiver knows is only named.

    A receiver that knows the same rig so gets back its own model, not a copy, and sees that modes did not change.
    """
    names = {} if known is None else {id(part): name for name, part in _parts(known).items()}
    stream = io.BytesIO()
    pickler = _Pickler(stream, names)
    pickler.dump(rig)
    return stream.getvalue()


def unpacked(parcel: bytes, known: Rig | None = None) -> Rig:
    """The rig that was packed with the same known one."""
    rig = _Unpickler(io.BytesIO(parcel), {} if known is None else _parts(known)).load()
    assert isinstance(rig, Rig)
    return rig


def _parts(rig: Rig) -> dict[str, object]:
    """The large parts of a rig that another may have from it."""
    return {"model": rig.plant.model, "surface": rig.surface, "coarse": rig.coarse, "probe": rig.probe}


class _Pickler(pickle.Pickler):
    # what a mesh alone determines is large and is made where it is needed, once
    dispatch_table = copyreg.dispatch_table | {Space: lambda space: (space_of, (space.mesh,))}

    def __init__(self, stream: io.BytesIO, names: dict[int, str]) -> None:
        super().__init__(stream, protocol=5)
        self._names = names

    def persistent_id(self, obj: object) -> str | None:
        return self._names.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, parts: dict[str, object]) -> None:
        super().__init__(stream)
        self._parts = parts

    def persistent_load(self, pid: str) -> object:
        return self._parts[pid]
