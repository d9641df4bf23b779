"""The rebuild chain beside the same written plainly: loops over elements and Gauss points that share no arithmetic."""

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flutterviz.bench.plain import plain_chain
from flutterviz.bench.rebuild import rebuilt
from solver import ControlError, Design, DesignError, Flow, MeshSize, Panel, Patches, Plant
from solver.design import Control, Load, Reduction
from solver.mesh import Floats

NX, NY, MODES = 6, 4, 8
APART = 1e-3  # least relative distance of frequencies: nearer than that, modes mix by rounding
# of the largest number: two eigensolvers on matrices whose condition is about 1e5, over the distance of frequencies
ROUNDING = 1e-8
# of the gain: its equation is solved in numbers of many sizes, and badly conditioned where patches hardly hold a root
RICCATI = 1e-7


@st.composite
def designs(draw: st.DrawFn, symmetric: bool) -> Design:
    """The seed's materials on a coarse mesh of a panel that is not square, any elements patched."""
    columns = [i * NY + j for i in range(NX) for j in range(NY // 2 if symmetric else NY)]
    elements = draw(st.sets(st.sampled_from(columns), min_size=1, max_size=8))
    if symmetric:
        elements |= {e // NY * NY + NY - 1 - e % NY for e in elements}
    return Design(
        panel=Panel(width=draw(st.floats(0.2, 0.28))),
        mesh=MeshSize(NX, NY),
        flow=Flow(dynamic_pressure=draw(st.floats(100.0, 1000.0))),
        patches=Patches(elements=tuple(elements), channels=draw(st.sampled_from(["connected", "element", "single"]))),
        reduction=Reduction("patched", MODES),
    )


def agree(ours: Floats, theirs: Floats, tolerance: float = ROUNDING) -> None:
    assert ours.shape == theirs.shape
    assert np.abs(ours - theirs).max() <= tolerance * np.abs(theirs).max()


def compare(design: Design, symmetric: bool) -> None:
    """Our chain against the plain one, whose modes are turned to our signs."""
    try:
        loop = rebuilt(design, symmetric)
    except ControlError:
        assume(False)
        return
    plant, model = loop.plant, loop.plant.model
    omega = Plant.of(design).model.omega
    assume(np.diff(omega).min() > APART * omega[0])
    chain = plain_chain(design, symmetric)
    free = model.plate.space.mesh.free_bending
    assert not chain.shapes[~free].any()
    share = model.shapes.T @ (model.plate.mass @ chain.shapes[free])
    sign = np.where(np.diag(share) < 0, -1.0, 1.0)
    agree(share * sign, np.eye(model.size))  # the same modes, and M-orthonormal
    np.testing.assert_allclose(chain.omega, model.omega, rtol=ROUNDING)
    agree(chain.stiffness * np.outer(sign, sign), plant.stiffness)
    agree(chain.damping * np.outer(sign, sign), plant.damping)
    agree(chain.force * sign[:, None], plant.force)
    r, s = np.triu_indices(model.size)
    agree(chain.quartic * np.outer(sign[r] * sign[s], sign[r] * sign[s]), model.membrane.quartic)
    for half in (slice(0, model.size), slice(model.size, None)):  # amplitudes and rates: units of their own
        agree((chain.gain * np.tile(sign, 2))[:, half], loop.law.gain[:, half], RICCATI)


@settings(max_examples=20, deadline=None)
@given(design=designs(symmetric=False))
def test_any_layout_comes_out_alike(design: Design) -> None:
    compare(design, symmetric=False)


@settings(max_examples=10, deadline=None)
@given(design=designs(symmetric=True))
def test_symmetric_layouts_do_in_their_symmetric_modes(design: Design) -> None:
    compare(design, symmetric=True)


@pytest.mark.parametrize(
    "change",
    [
        {"panel": Panel(edges="scsc")},
        {"load": Load(temperature=1.0)},
        {"flow": Flow(yaw_deg=10.0)},
        {"flow": Flow(mach=3.0)},
        {"control": Control(kind="off")},
        {"reduction": Reduction("family", 4)},
        {"patches": Patches()},
        {"patches": Patches(elements=(5,), material="pzt5a")},
    ],
    ids=lambda change: repr(next(iter(change.values())))[:30],
)
def test_what_it_leaves_out_is_refused(change: dict[str, object]) -> None:
    whole = Design(mesh=MeshSize(NX, NY), patches=Patches(elements=(5,)), reduction=Reduction("patched", 4))
    with pytest.raises(DesignError, match="the plain chain is for"):
        plain_chain(msgspec.structs.replace(whole, **change))
