"""Sessions that tests drive, on rigs that are built once, and what is looked at in them."""

from functools import lru_cache

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from flutterviz import commands as do
from flutterviz.rig import Rig, rig_of
from flutterviz.session import Session
from solver import Design, load_design

Floats = NDArray[np.floating]

SAMPLE = 2e-4  # s: 28 in a period of the seed panel's flutter

FULL = load_design("seed-840")
LIGHT = FULL.with_reduction("patched", 8)  # what is said here of commands holds for any basis; this one is quick
BARE = load_design("seed-bare").with_reduction("patched", 8)
STRETCH = 0.005  # s: a picture at a twentieth of real time is about a third of it

elements = st.integers(0, 143)
pressures = st.floats(0, 1500)
changes = st.one_of(
    st.builds(do.TogglePatch, elements),
    st.builds(do.ClearPatches),
    st.builds(do.SetFlow, pressures),
    st.sampled_from([do.LoadDesign(BARE, "seed-bare"), do.LoadDesign(LIGHT, "seed-840")]),
)


@lru_cache
def rig(design: Design) -> Rig:
    """The rig of a design, built once for all tests."""
    return rig_of(design)


def session_on(design: Design) -> Session:
    return Session(design, rig(design))


def run_on(session: Session, seconds: float) -> None:
    for _ in range(round(seconds / STRETCH)):
        session.advance(STRETCH)


def texts(session: Session) -> list[str]:
    return [event.text for event in session.take_events()]


def field(rig: Rig, halves: Floats) -> Floats:
    """(2, free dofs) nodal values of w and w,t of a state (2, n)."""
    return halves @ rig.plant.model.shapes.T


def projected(new: Rig, motion: Floats) -> Floats:
    """(2n,) the state of a rig nearest to nodal values (2, free dofs) in its kinetic energy, by normal equations."""
    shapes, mass = new.plant.model.shapes, new.plant.model.plate.mass
    weighed = mass @ shapes
    return np.linalg.solve(shapes.T @ weighed, (motion @ weighed).T).T.ravel()


def nodal_jump(session: Session, before: Floats) -> float:
    """Largest change of w at a node since nodal values (2, free dofs), over h."""
    nodes = session.rig.plant.model.plate.space.mesh.free_bending.nonzero()[0] % 4 == 0  # w, not its derivatives
    after = field(session.rig, session.state.reshape(2, -1))
    return float(np.abs(after - before)[0, nodes].max() / session.rig.thickness)
