"""The thesis' counts: what the experiment says of small bodies."""

import pytest

from experiments.harness.meshes import thesis_meshes
from experiments.thesis import bodies, resolution
from experiments.thesis.table_6_1 import TABLE_VOXELS
from tests.exhibits import measured


def test_cubes_grow_with_their_surface():
    """The shells are 6 n^2 - 12 n + 8; the cells tend to 4/3 of that, times no log."""
    result = measured("section-6.1-cubes").numbers
    for row in result["rows"]:
        n = row["side_voxels"]
        assert row["full_volume"] == n**3
        assert row["shell"] == 6 * n * n - 12 * n + 8
        assert row["shell"] < row["cells"] < 4 / 3 * row["shell"]
    # Of cubes of 8 to 128 voxels.
    assert result["growth_beyond_n2_claimed"] == pytest.approx(7 / 3)


def test_shares_are_of_the_body_and_of_the_box(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    bodies._statues.cache_clear()
    row = resolution.counts("figurine", 24)
    bodies._statues.cache_clear()
    assert row["lattice_shape"][2] == 24
    assert 0 < row["shell"] <= row["irregular"] < row["body"] < row["box"]
    assert row["shell_of_box"] == row["shell"] / row["box"]
    # The full volume of table 6.1 is its box.
    thesis_box = 225 * 550 * 225
    assert f"{thesis_box:.1e}" == f"{TABLE_VOXELS['full volume']:.1e}"


def test_without_the_meshes_the_figurine_stands_in(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    assert list(thesis_meshes()) == ["figurine"]
