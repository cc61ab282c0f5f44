"""The thesis' counts: what the experiment says of small bodies."""

import pytest

from experiments.harness.meshes import thesis_meshes
from experiments.thesis.counting import (
    _count_heights,
    _count_table_6_1,
    _measure_capacity,
    count_cubes,
    cube_table,
)
from jaxthermo.geometry.shapes import figurine


def test_cubes_grow_with_their_surface():
    """The shells are 6 n^2 - 12 n + 8; the cells tend to 4/3 of that, times no log."""
    result = count_cubes(range(3, 5))
    for row in result["rows"]:
        n = row["side_voxels"]
        assert row["full_volume"] == n**3
        assert row["shell"] == 6 * n * n - 12 * n + 8
        assert row["shell"] < row["cells"] < 4 / 3 * row["shell"]
    assert result["growth_beyond_n2_claimed"] == pytest.approx(4 / 3)
    assert len(cube_table(result).rows) == 2


def test_shares_are_of_the_body_and_of_the_box():
    (row,) = _count_heights(figurine(0.5), (24,))
    assert row["lattice_shape"][2] == 24
    assert 0 < row["shell"] <= row["irregular"] < row["body"] < row["box"]
    assert row["shell_of_box"] == row["shell"] / row["box"]
    table = _count_table_6_1(figurine(0.5), 24)
    assert table["ours"] == row
    assert f"{table['thesis_box_cells']:.1e}" == f"{table['thesis']['full_volume']:.1e}"


def test_regions_add_up_to_the_body():
    result = _measure_capacity(figurine(0.5), 24)
    cells, body = (sum(result["map"][key]) for key in ("cells_m3", "body_m3"))
    assert cells / body == pytest.approx(result["capacity_ratio"])
    assert result["capacity_ratio_kept"] == pytest.approx(1, abs=1e-12)


def test_without_the_meshes_the_figurine_stands_in(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    assert list(thesis_meshes()) == ["figurine"]
