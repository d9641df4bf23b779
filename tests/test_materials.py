"""The materials: each has a source and a stiffness that resists, and what cannot be is refused in one line."""

import math
import pickle

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.errors import DesignError
from solver.materials import Material, material, material_names

PIEZO = {"pzt5a", "pzt5h", "pvdf", "mfc-d31", "mfc-d33"}
PROMISED = {
    "aluminium",
    "aluminium-7075",
    "steel",
    "titanium-6al-4v",
    "graphite-epoxy",
    "graphite-epoxy-as4-3501",
    "glass-epoxy",
    "kevlar-epoxy",
    "boron-epoxy",
    *PIEZO,
}


def lamina(**changes: float) -> Material:
    return msgspec.structs.replace(material("graphite-epoxy"), **changes)


def test_library_has_what_is_promised() -> None:
    names = material_names()
    assert set(names) >= PROMISED
    assert names == sorted(set(names))


@pytest.mark.parametrize("name", material_names())
def test_entry_is_whole(name: str) -> None:
    entry = material(name)
    assert entry.name == name == name.lower().replace(" ", "-")
    assert len(entry.source) > 30, "a citation, not a word"
    assert "\n" not in entry.source
    assert entry.young_1 >= entry.young_2, "axis 1 is the stiff one"
    # What a solid that flies can have: a slip of a power of ten, or of a unit, falls outside.
    assert entry.young_2 >= 1e9
    assert entry.young_1 <= 5e11
    assert 1000 <= entry.density <= 9000
    assert all(-1e-5 <= value <= 2e-4 for value in (entry.expansion_1, entry.expansion_2))
    assert (entry.d31 != 0) == (entry.max_field > 0) == (name in PIEZO)


@pytest.mark.parametrize("name", material_names())
def test_stiffness_resists_every_strain_and_inverts_to_the_compliance(name: str) -> None:
    """S of the engineering constants (Jones 2.62) is written down directly, and Q must be its inverse."""
    m = material(name)
    q = m.stiffness
    assert q.shape == (3, 3)
    assert np.array_equal(q, q.T)
    assert np.linalg.eigvalsh(q).min() > 0
    coupling = -m.poisson_12 / m.young_1
    compliance = np.array([[1 / m.young_1, coupling, 0], [coupling, 1 / m.young_2, 0], [0, 0, 1 / m.shear_12]])
    np.testing.assert_allclose(q @ compliance, np.eye(3), atol=1e-13)  # rounding of a 3 x 3 product


@pytest.mark.parametrize("name", ["aluminium", "aluminium-7075", "steel", "titanium-6al-4v", "pzt5a", "pzt5h"])
def test_isotropic_entry_is_isotropic(name: str) -> None:
    entry = material(name)
    again = Material.isotropic(
        entry.young_1, entry.poisson_12, entry.density, entry.expansion_1, entry.d31, entry.max_field
    )
    assert again.shear_12 == pytest.approx(entry.shear_12, rel=1e-12)  # the same formula, through decimal digits
    for field in ("young_2", "expansion_2", "d32", "max_field"):
        assert getattr(again, field) == getattr(entry, field)


@given(young=st.floats(1e6, 1e12), poisson=st.floats(-0.99, 0.499))
def test_isotropic_stiffness(young: float, poisson: float) -> None:
    shear = (1 - poisson) / 2
    wanted = young / (1 - poisson**2) * np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, shear]])
    made = Material.isotropic(young, poisson, 2700.0, 22.5e-6).stiffness
    # 1 - ν² loses up to two digits near ν = -1
    np.testing.assert_allclose(made, wanted, rtol=1e-12, atol=1e-12 * young)


def test_the_papers_two_materials() -> None:
    """Table 4.1 of the paper: 10 Msi and 9 Msi, and d31 of the ceramic."""
    panel, ceramic = material("aluminium"), material("pzt5a")
    assert (panel.young_1, panel.poisson_12, panel.density, panel.expansion_1) == (68.95e9, 0.3, 2700, 22.5e-6)
    assert (ceramic.young_1, ceramic.poisson_12, ceramic.density) == (62e9, 0.3, 7593)
    assert ceramic.d31 == ceramic.d32 == -1.91e-10
    assert ceramic.max_field == 600e3


def test_lamina_stiffness_of_the_textbook() -> None:
    """Tsai and Hahn's T300/5208: Q = 181.8, 10.34, 2.897, 7.17 GPa, given there to four digits."""
    q = material("graphite-epoxy").stiffness / 1e9
    assert q[0, 0] == pytest.approx(181.8, abs=0.05)
    assert q[1, 1] == pytest.approx(10.34, abs=0.01)
    assert q[0, 1] == pytest.approx(2.897, abs=0.001)
    assert q[2, 2] == 7.17


@pytest.mark.parametrize(
    ("name", "volts", "strain"),
    [("mfc-d31", -60, 66e-6), ("mfc-d33", 1000, 750e-6)],
)
def test_macro_fibre_composite_strains_as_its_data_sheet_says(name: str, volts: float, strain: float) -> None:
    """Free strain a volt, 1.1e-6 (P2) and 0.75e-6 (P1), through the field V/h_p of a patch 0.3 mm thick."""
    assert material(name).d31 * volts / 0.3e-3 == pytest.approx(strain, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"young_1": 0.0}, "young_1"),
        ({"young_1": math.inf}, "young_1"),
        ({"young_2": -1e9}, "young_2"),
        ({"shear_12": 0.0}, "shear_12"),
        ({"shear_12": math.nan}, "shear_12"),
        ({"density": -1600.0}, "density"),
        ({"density": math.inf}, "density"),
        ({"poisson_12": 4.2}, "poisson_12"),  # √(181/10.3) = 4.192
        ({"poisson_12": -4.2}, "poisson_12"),
        ({"poisson_12": math.nan}, "poisson_12"),
        ({"expansion_1": math.nan}, "expansion_1"),
        ({"expansion_2": 22.5}, "expansion_2"),  # given in 1e-6/K
        ({"d31": math.nan, "max_field": 1e5}, "d31"),
        ({"d32": math.inf, "max_field": 1e5}, "d32"),
        ({"max_field": -1.0}, "max_field"),
        ({"max_field": math.nan}, "max_field"),
        ({"d31": -1e-10}, "max_field"),  # piezoelectric, but bears no field
    ],
)
def test_impossible_material_is_refused(changes: dict[str, float], told: str) -> None:
    with pytest.raises(DesignError) as caught:
        lamina(**changes)
    text = str(caught.value)
    assert f"graphite-epoxy.{told} = " in text
    assert "\n" not in text


def test_poisson_limit_is_that_of_a_positive_stiffness() -> None:
    """Q stops being positive definite where ν12² = E1/E2; on this side of it a material is let through."""
    limit = math.sqrt(181 / 10.3)
    assert np.linalg.eigvalsh(lamina(poisson_12=0.999 * limit).stiffness).min() > 0
    with pytest.raises(DesignError, match="poisson_12"):
        lamina(poisson_12=1.001 * limit)


@pytest.mark.parametrize("poisson", [0.5, -1.0, 1e9, math.nan])
def test_isotropic_poisson_has_narrower_limits(poisson: float) -> None:
    """An isotropic solid has them from its bulk: -1 < ν < 1/2."""
    with pytest.raises(DesignError, match=r"poisson.*between -1 and 0\.5"):
        Material.isotropic(70e9, poisson, 2700.0, 22.5e-6)


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("aluminum", "aluminium"),
        ("PZT5A", "pzt5a"),
        ("graphite_epoxy", "graphite-epoxy"),
        ("titanium", "titanium-6al-4v"),
        ("", None),
        ("unobtainium\nof two lines", None),
    ],
)
def test_unknown_name_is_answered_with_those_known_nearest_first(name: str, nearest: str | None) -> None:
    with pytest.raises(DesignError) as caught:
        material(name)
    text = str(caught.value)
    assert "\n" not in text
    listed = text.split("materials are ")[1].split(", ")
    assert sorted(listed) == material_names()
    if nearest:
        assert listed[0] == nearest


def test_misspelt_field_is_refused() -> None:
    whole = msgspec.to_builtins(material("steel"))
    assert msgspec.convert(whole, Material) == material("steel")
    with pytest.raises(msgspec.ValidationError, match="youngs"):
        msgspec.convert({**whole, "youngs": 1.0}, Material)


def test_material_is_a_value() -> None:
    steel = material("steel")
    assert steel is material("steel"), "read once"
    assert pickle.loads(pickle.dumps(steel)) == steel
    assert len({steel, pickle.loads(pickle.dumps(steel)), material("pvdf")}) == 2
    with pytest.raises(AttributeError):
        steel.density = 1.0  # type: ignore[misc]
