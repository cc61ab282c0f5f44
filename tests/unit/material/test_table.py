"""Materials: what is refused, what is derived, and the table."""

import csv
import importlib
from collections.abc import Mapping
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo
from jaxthermo.errors import InputError
from jaxthermo.material.material import Material
from jaxthermo.material.table import (
    emissivity_row,
    emissivity_rows,
    material_row,
    material_rows,
    materials,
    thesis_material,
)


THESIS_ROWS = [
    "platinum",
    "gold",
    "mercury",
    "lead",
    "silver",
    "copper",
    "iron",
    "diamond",
    "aluminium",
    "water",
    "ethanol",
    "gasoline",
]


def test_derived_properties():
    steel = Material(conductivity=16.0, density=8000.0, specific_heat=500.0)
    assert steel.volumetric_heat_capacity == 4.0e6
    assert steel.diffusivity == 4.0e-6
    assert steel.effusivity == 8000.0
    assert steel.emissivity == 0.9
    assert steel.absorptivity == 0.9


def test_absorptivity_is_the_emissivity_unless_given():
    assert Material(1.0, 1.0, 1.0, 0.3).absorptivity == 0.3
    assert Material(1.0, 1.0, 1.0, 0.3, absorptivity=0.0).absorptivity == 0.0
    grey = Material(1.0, 1.0, 1.0, 0.3)
    fitted = eqx.tree_at(lambda m: m.emissivity, grey, 0.5)
    assert fitted.absorptivity == 0.5


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"conductivity": 0.0}, r"conductivity=0.0: give a positive.*W/\(m K\)"),
        ({"density": -1.0}, "density=-1.0: give a positive"),
        ({"specific_heat": np.inf}, "specific_heat=inf: give a positive, finite"),
        ({"specific_heat": np.nan}, "specific_heat=nan"),
        ({"emissivity": 1.1}, "emissivity=1.1: give a fraction"),
        ({"emissivity": np.nan}, "emissivity=nan"),
        ({"absorptivity": -0.1}, "absorptivity=-0.1: give a fraction"),
        ({"density": jnp.asarray(-2.0)}, "density=-2.0"),
    ],
)
def test_refused_values(change, says):
    numbers = {"conductivity": 1.0, "density": 1.0, "specific_heat": 1.0}
    with pytest.raises(InputError, match=says):
        Material(**{**numbers, **change})


def test_traced_values_and_gradients():
    def diffusivity(k, rho):
        return Material(k, rho, 500.0).diffusivity

    k = jnp.asarray(16.0)
    rho = jnp.asarray(8000.0)
    assert jax.jit(diffusivity)(k, rho) == 4.0e-6
    slope = jax.grad(diffusivity, argnums=(0, 1))(k, rho)
    assert_allclose(slope[0], 1.0 / 4.0e6)
    assert_allclose(slope[1], -4.0e-6 / 8000.0)


def test_is_a_pytree_of_its_numbers():
    steel = Material(16.0, 8000.0, 500.0)
    assert jax.tree_util.tree_leaves(steel) == [16.0, 8000.0, 500.0, 0.9]


def test_float32_stays_float32():
    steel = Material(*(jnp.asarray(x, jnp.float32) for x in (16.0, 8e3, 500.0)))
    assert jnp.asarray(steel.effusivity).dtype == jnp.float32


def test_table_has_every_row_of_the_data():
    rows = material_rows()
    assert len(rows) == len(materials) == 78
    data = Path(jaxthermo.__file__).parent / "data"
    for file, used in (
        ("materials.csv", {row.label for row in rows}),
        ("emissivity.csv", {row.surface for row in emissivity_rows()}),
    ):
        with (data / file).open(encoding="utf-8", newline="") as lines:
            assert {row["material"] for row in csv.DictReader(lines)} == used
    assert list(materials) == [row.name for row in rows]
    assert all(name == name.lower() and name.isidentifier() for name in materials)
    assert all(isinstance(materials[name], Material) for name in materials)
    assert isinstance(materials, Mapping)


def test_known_numbers():
    steel = materials["stainless_steel"]
    assert (steel.conductivity, steel.density, steel.specific_heat) == (17, 7900, 460)
    assert steel.emissivity == 0.16
    assert materials["copper"].conductivity == 401.0
    assert_allclose(materials["copper"].diffusivity, 1.162e-4, rtol=1e-3)
    assert_allclose(materials["copper"].effusivity, 3.719e4, rtol=1e-3)


def test_derived_columns_of_the_data_are_those_of_the_properties():
    data = Path(jaxthermo.__file__).parent / "data" / "materials.csv"
    with data.open(encoding="utf-8", newline="") as lines:
        columns = {row["material"]: row for row in csv.DictReader(lines)}
    for row in material_rows():
        material = materials[row.name]
        stated = columns[row.label]
        assert_allclose(material.diffusivity, float(stated["alpha_m2_s"]), rtol=1e-3)
        assert_allclose(material.effusivity, float(stated["effusivity"]), rtol=1e-3)


# Rows of which a number has no source that was read; this list only gets shorter.
WITHOUT_SOURCE = {
    "dry_soil",
    "mineral_wool",
    "pyrolytic_graphite",
    "back_sheet",
    "car paint, silver",
    "car paint, black",
}


def test_every_number_has_a_source():
    sources = {row.name: row.bulk_source for row in material_rows()}
    sources |= {row.surface: row.sources for row in emissivity_rows()}
    assert all(sources.values())
    assert {name for name, text in sources.items() if "recalled" in text} == (
        WITHOUT_SOURCE
    )


def test_materials_of_electronics_and_printed_parts():
    for name in ("abs", "pla", "polyamide", "polycarbonate", "epoxy"):
        plastic = materials[name]
        assert 5e-8 < plastic.diffusivity < 2e-7
        assert "emissivity none tabulated, assumed 0.9" in material_row(name).source
    # (1 + 0.039 m) c of dry leather with m per cent of water, of 5.33 kJ/(kg K).
    leather = materials["leather"]
    assert leather.specific_heat == pytest.approx(5330 / 3.9, rel=3e-3)
    assert leather.emissivity == 0.77
    board = material_row("pcb")
    assert (board.name, board.emissivity) == ("fr4", 0.91)
    assert "1.059 along it" in board.source
    # The fit of NIST for glass fibre and epoxy at 300 K.
    coefficients = [
        -2.4083,
        7.6006,
        -8.2982,
        7.3301,
        -4.2386,
        1.4294,
        -0.24396,
        0.015236,
    ]
    fitted = 10 ** np.polynomial.polynomial.polyval(np.log10(300.0), coefficients)
    assert_allclose(board.specific_heat, fitted, rtol=1e-3)
    cell = material_row("lithium_cell")
    assert_allclose(cell.density, 0.0456 / (np.pi / 4 * 0.0182**2 * 0.0651), rtol=1e-3)
    assert_allclose(cell.specific_heat, 0.45489 * 298.15 + 684.87, rtol=1e-3)
    assert_allclose(cell.conductivity, 1.10435 - 9.7338e-4 * 298.15, rtol=1e-3)


def test_paints_are_finishes():
    white, black, metallic = (
        emissivity_row(f"paint, {colour}") for colour in ("white", "black", "aluminium")
    )
    assert (white.emissivity, white.absorptivity) == (0.9, 0.24)
    assert (black.emissivity, black.absorptivity) == (0.91, 0.96)
    assert (metallic.emissivity, metallic.absorptivity) == (0.31, 0.3)


def test_solar_absorptivities():
    # The sun passes a pane, and its long waves do not.
    glass = materials["car_glass"]
    assert (glass.emissivity, glass.absorptivity) == (0.84, 0.11)
    assert "transmitted 0.82 is not modelled" in material_row("car_glass").source
    assert materials["grass"].absorptivity == 0.8
    soil = materials["moist_soil"]
    assert materials["grass"].conductivity == soil.conductivity == 0.9
    # Where none is tabulated, the emissivity stands for it.
    assert materials["cast_iron"].given_absorptivity is None
    assert materials["cast_iron"].absorptivity == 0.8
    for row in emissivity_rows():
        assert row.absorptivity is None or 0 < row.absorptivity < 1
        assert (row.absorptivity is None) == (row.absorptivity_source == "")


def test_finishes_have_names():
    assert emissivity_row("car paint, white").absorptivity == 0.4
    expected = "'car paint' .* did you mean 'car paint, white' or 'car paint, silver'"
    with pytest.raises(InputError, match=expected):
        emissivity_row("car paint")
    with pytest.raises(InputError, match="'human skin' or 'water'"):
        emissivity_row("zzz")


def test_aliases():
    assert materials["aluminum"] == materials["aluminium"]
    assert "steel" in materials and "steel" not in list(materials)


def test_the_source_says_where_the_emissivity_comes_from():
    assert "of 'brick, red', IDEAL" in material_row("brick").source
    gold = material_row("gold")
    assert gold.emissivity == 0.9
    assert "none tabulated, assumed 0.9" in gold.source
    assert "CRC" in gold.source


def test_unknown_names_get_help():
    with pytest.raises(InputError, match="'stainles' .* did you mean stainless_steel"):
        materials["stainles"]
    with pytest.raises(InputError, match="plywood"):
        materials["wood"]
    with pytest.raises(InputError, match="platinum, gold"):
        materials["zzz"]


def test_get_and_in_do_not_raise():
    assert "unobtainium" not in materials
    assert materials.get("unobtainium") is None
    assert materials.get("copper") == materials["copper"]


def test_the_package_gives_the_mapping_and_not_a_module():
    importlib.import_module("jaxthermo.material.table")
    assert jaxthermo.materials is materials


def testthesis_materials():
    assert [row.name for row in material_rows() if row.in_thesis] == THESIS_ROWS
    gold = thesis_material("gold")
    assert (gold.density, gold.specific_heat, gold.emissivity) == (19300, 126, 1)
    assert gold.conductivity == 318.0
    with pytest.raises(InputError, match="not in Table 5.1: use one of platinum"):
        thesis_material("titanium")
