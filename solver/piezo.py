"""Owns the wiring of the patches: which of them share a voltage, and the modal force that a volt gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solver.design import Design
from solver.laminate import moment_per_volt
from solver.mesh import Floats, Mesh
from solver.modes import ModalModel


def channels(design: Design) -> list[tuple[int, ...]]:
    """The sets of patched elements that share a voltage (the seed's sets), by their smallest element."""
    elements = design.patches.elements
    if not elements:
        return []
    match design.patches.channels:
        case "single":
            return [elements]
        case "element":
            return [(e,) for e in elements]
        case "connected":
            return Mesh.of(design.panel, design.mesh).connected_groups(elements)


def element_forces(model: ModalModel, design: Design, elements: Sequence[int] | None = None) -> Floats:
    """(n, elements) modal force a volt on a pair of layers on each element, patched or not [N/(V·√kg)].

    F_r = ∫ Mᵀ κ dA for mode r, with M the moments a volt: the seed's -K_bφ in modal form (2.22).

    Args:
        model: the modes.
        design: the ceramic.
        elements: ids of the elements that are asked for; None for all.
    """
    space = model.plate.space
    dofs = space.mesh.bending_dofs if elements is None else space.mesh.bending_dofs[list(elements)]
    local = space.expand(model.shapes)[dofs]  # (elements, 16, n)
    return np.einsum("i,ein->ne", moment_per_volt(design) @ space.moment_integral, local)


def channel_forces(model: ModalModel, design: Design) -> Floats:
    """(n, channels) modal force a volt on each channel [N/(V·√kg)]."""
    groups = channels(design)
    mesh = model.plate.space.mesh
    result = np.zeros((model.size, len(groups)))
    for k, group in enumerate(groups):
        # a set symmetric about y = b/2 does not drive antisymmetric modes at all: rounding must not either
        odd = (model.parity == -1) & (mesh.mirror_image(group) == group)
        result[:, k] = np.where(odd, 0.0, element_forces(model, design, group).sum(axis=1))
    return result
