"""Owns what is told of a rig but takes longer than building it: how far it holds, and its root locus over the gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flutterviz.rig import Rig
from solver import Design
from solver.holding import Hold, stabilises_up_to
from solver.rootlocus import gain_locus

FACTORS = np.linspace(0.0, 1.0, 15) ** 2  # of the gain: poles move fastest where it is small


@dataclass(frozen=True)
class Outlook:
    """What a rig's controller can do beyond this moment."""

    design: Design
    """The design of the rig."""
    hold: Hold | None
    """How far in λ it stabilises; None where nothing flutters at any λ."""
    locus: NDArray[np.complex128]
    """(factors, poles) poles as the loop is closed [1/s]."""


def outlook_of(rig: Rig) -> Outlook:
    """Look ahead for a rig; takes some tenths of a second."""
    plant, law = rig.plant, rig.loop.law
    return Outlook(rig.design, stabilises_up_to(plant), gain_locus(plant, law, FACTORS).astype(np.complex128))
