"""`jaxthermo materials`: the table, a search, one in full, and the finishes."""

import pytest

from jaxthermo.__main__ import main
from jaxthermo.image.colour.palette import palette_names
from jaxthermo.material.stacks import stack_rows
from jaxthermo.material.table import emissivity_rows, find_materials, material_rows


@pytest.fixture
def printed(capsys, monkeypatch):
    """A function from arguments to the lines that they print."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: str) -> list[str]:
        with pytest.raises(SystemExit) as stopped:
            main(["materials", *arguments])
        assert stopped.value.code == 0
        return capsys.readouterr().out.splitlines()

    return run


def test_every_material_has_a_line_of_its_own(printed):
    lines = printed()
    rows = material_rows()
    (end,) = (n for n, line in enumerate(lines) if line.split()[:1] == ["stack"])
    for row in rows:
        matching = [line for line in lines[:end] if line.split()[:1] == [row.name]]
        assert len(matching) == 1
        assert f"{row.conductivity:g}" in matching[0].split()
        assert ("*" in matching[0].split()) == row.in_thesis
        assert (f"~{row.emissivity:g}" in matching[0]) == (row.surface is None)
    assert sum(" * " in line for line in lines[:-1]) == 12
    # In a pipe lines are whole: sources fit beside the numbers, nothing is cut off.
    layer_count = sum(map(len, stack_rows().values()))
    assert len(lines) == len(material_rows()) + 6 + layer_count + 4
    assert not any("…" in line for line in lines)
    assert "Table 5.1 of the thesis" in lines[-1]


def test_a_part_of_a_name_lists_what_has_it(printed):
    text = "\n".join(printed("ste"))
    assert "carbon_steel" in text and "stainless_steel" in text
    assert "copper" not in text


@pytest.mark.parametrize("name", ["gold", "gol", "GOLD"])
def test_one_in_full(printed, name):
    text = "\n".join(printed(name))
    assert text.startswith("gold (gold)")
    assert "318" in text and "rho 19300, c_p 126 (Table 5.1)" in text
    assert "none tabulated, assumed 0.9" in text


def test_stacks_of_the_ground_are_listed_with_their_layers(printed):
    lines = printed()
    (first,) = (
        n for n, line in enumerate(lines) if line.split()[:2] == ["asphalt", "asphalt"]
    )
    assert lines[first + 1].split()[:2] == ["sand_and_gravel", "0.3"]
    assert lines[first + 2].split()[:2] == ["moist_soil", "0.5"]
    grass = printed("grass")
    assert grass[0].startswith("grass (clay soil")
    assert any(line.split()[:3] == ["grass", "grass", "0.75"] for line in grass)
    assert any(line.split()[:1] == ["concrete_on_soil"] for line in printed("on_soil"))


def test_the_absorptivity_of_sunlight_is_printed_where_it_is_tabulated(printed):
    assert "  absorptivity  0.8 (of sunlight)" in printed("grass")
    assert "(of sunlight)" not in "\n".join(printed("gold"))


def test_an_alias_is_a_name(printed):
    assert printed("steel")[0].startswith("carbon_steel")


def test_finishes(printed):
    text = "\n".join(printed("--emissivity"))
    for row in emissivity_rows():
        assert row.surface in text
        if row.absorptivity is not None:
            assert f" {row.absorptivity:g} " in text
    assert len(emissivity_rows()) == 49
    assert "long-wave infrared" in text
    some = "\n".join(printed("alu", "--emissivity"))
    assert "aluminium foil" in some and "brick" not in some


def test_find_materials_looks_at_labels_and_aliases_too():
    assert [row.name for row in find_materials("octane")] == ["gasoline"]
    assert [row.name for row in find_materials("Petrol")] == ["gasoline"]
    assert find_materials("zzz") == ()


def test_palettes_are_listed_with_the_differences_of_their_colours(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["palettes"])
    assert stopped.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    for name in palette_names():
        (line,) = (line for line in lines if line.split()[:1] == [name])
        assert all(float(number) >= 0 for number in line.split()[1:])
