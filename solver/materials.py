"""Owns the materials: what a layer is made of, and the library of them that comes with the package."""

from __future__ import annotations

import difflib
import math
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from solver.errors import DesignError

_HERE = Path(__file__).resolve().parent
# A wheel carries the library inside the package; a checkout has it where people look for it.
_LIBRARY = next(
    (p for p in (_HERE / "materials.json", _HERE.parent / "assets" / "materials.json") if p.is_file()),
    _HERE / "materials.json",
)


class Material(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An orthotropic layer in plane stress: axis 1 along the fibres, axis 2 across them, axis 3 the thickness.

    An isotropic material is one whose two axes agree; a piezoelectric one is poled through its thickness.
    """

    name: str
    """Name in the library, in lower case with hyphens."""
    young_1: float
    """Young's modulus along the fibres E1 [Pa]."""
    young_2: float
    """Young's modulus across the fibres E2 [Pa]."""
    poisson_12: float
    """Major Poisson's ratio ν12, contraction along 2 for a pull along 1 [-]."""
    shear_12: float
    """In-plane shear modulus G12 [Pa]."""
    density: float
    """Mass density [kg/m³]."""
    expansion_1: float
    """Coefficient of thermal expansion along the fibres [1/K]."""
    expansion_2: float
    """Coefficient of thermal expansion across the fibres [1/K]."""
    d31: float = 0.0
    """Piezoelectric charge constant, strain along 1 a unit field through the thickness; 0 if passive [m/V]."""
    d32: float = 0.0
    """Piezoelectric charge constant, strain along 2 a unit field through the thickness; 0 if passive [m/V]."""
    max_field: float = 0.0
    """Largest field against the poling that does no harm; 0 if passive [V/m]."""
    source: str = ""
    """Where the values are from, and which of them are estimates."""

    def __post_init__(self) -> None:
        """Refuse what no material can be."""
        for field in ("young_1", "young_2", "shear_12", "density"):
            value = getattr(self, field)
            self._check(math.isfinite(value) and 0 < value < 1e30, field, value, "must be a positive number")
        # Jones, Mechanics of Composite Materials, section 2.4.2: else some stress would give back work without end.
        limit = math.sqrt(self.young_1 / self.young_2)
        self._check(
            abs(self.poisson_12) < limit,
            "poisson_12",
            self.poisson_12,
            f"must lie between -{limit:.4g} and {limit:.4g}, ±√(young_1/young_2), or the stiffness is not positive",
        )
        for field in ("expansion_1", "expansion_2"):
            value = getattr(self, field)
            self._check(abs(value) <= 1e-2, field, value, "must be a strain a kelvin, as 2.3e-5")
        for field in ("d31", "d32"):
            value = getattr(self, field)
            self._check(math.isfinite(value), field, value, "must be a finite number [m/V]")
        self._check(0 <= self.max_field < 1e30, "max_field", self.max_field, "must be a field from 0 on [V/m]")
        self._check(
            self.max_field > 0 or self.d31 == self.d32 == 0,
            "max_field",
            self.max_field,
            "a piezoelectric material bears some field; give one above 0 [V/m]",
        )

    def _check(self, ok: bool, field: str, value: object, remedy: str) -> None:
        if not ok:
            raise DesignError(f"material {self.name or 'unnamed'}.{field} = {value}: {remedy}")

    @staticmethod
    def isotropic(
        young: float,
        poisson: float,
        density: float,
        expansion: float,
        d31: float = 0.0,
        max_field: float = 0.0,
    ) -> Material:
        """A material with no direction in its plane, G = E/(2(1 + ν)) and d32 = d31; not in the library.

        Raises:
            DesignError: a value that no material can have.
        """
        if not -1 < poisson < 0.5:  # NaN fails both comparisons
            raise DesignError(f"material isotropic.poisson = {poisson}: must lie between -1 and 0.5")
        return Material(
            name="isotropic",
            young_1=young,
            young_2=young,
            poisson_12=poisson,
            shear_12=young / (2 * (1 + poisson)),
            density=density,
            expansion_1=expansion,
            expansion_2=expansion,
            d31=d31,
            d32=d31,
            max_field=max_field,
            source="given as numbers",
        )

    @property
    def stiffness(self) -> NDArray[np.floating]:
        """(3, 3) reduced stiffness Q in plane stress and material axes [Pa] (Jones, Mechanics of Composites, 2.61).

        Rows and columns are 11, 22 and the engineering shear 12; ν21 = ν12 E2/E1.
        """
        poisson_21 = self.poisson_12 * self.young_2 / self.young_1
        share = 1 - self.poisson_12 * poisson_21
        coupling = self.poisson_12 * self.young_2 / share
        return np.array(
            [
                [self.young_1 / share, coupling, 0.0],
                [coupling, self.young_2 / share, 0.0],
                [0.0, 0.0, self.shear_12],
            ]
        )


@lru_cache(maxsize=1)
def _library() -> dict[str, Material]:
    return {entry.name: entry for entry in msgspec.json.decode(_LIBRARY.read_bytes(), type=list[Material])}


def material_names() -> list[str]:
    """Names of the materials in the library, sorted."""
    return sorted(_library())


def material(name: str) -> Material:
    """The material of that name in the library.

    Raises:
        DesignError: there is none; the message lists those that there are, the likeliest first.
    """
    library = _library()
    if name not in library:
        near = difflib.get_close_matches(name.lower(), library, n=3, cutoff=0.4)
        known = near + [other for other in sorted(library) if other not in near]
        shown = " ".join(name.split())[:40]
        raise DesignError(f"{shown or 'an empty name'}: no such material; materials are {', '.join(known)}")
    return library[name]
