"""Union and difference have the volumes of inclusion and exclusion."""

import importlib.util

import pytest

import jaxthermo as jt
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh, describe_mesh


ONE = shapes.box(1.0)
# Half of its volume is in the first.
OTHER = shapes.box((1.0, 0.5, 0.5)).moved((0.5, 0.0, 0.0))

needs_library = pytest.mark.skipif(
    importlib.util.find_spec("manifold3d") is None, reason="the extra is not installed"
)


@needs_library
def test_union_and_difference_have_exact_volumes():
    united = shapes.union(ONE, OTHER)
    remaining = shapes.difference(ONE, OTHER)
    assert united.volume == pytest.approx(1.0 + 0.25 - 0.125, rel=1e-9)
    assert remaining.volume == pytest.approx(1.0 - 0.125, rel=1e-9)
    # All faces of the box, the sides of what sticks out, and its end for the hole.
    assert united.area == pytest.approx(6.0 + 4 * 0.5 * 0.5, rel=1e-9)
    assert remaining.area == pytest.approx(6.0 + 4 * 0.5 * 0.5, rel=1e-9)
    for mesh in (united, remaining):
        assert mesh.is_watertight and describe_mesh(mesh)["bodies"] == 1
        assert mesh.volume == pytest.approx(
            jt.voxelize(mesh, 0.125).solid_count * 0.125**3, rel=1e-9
        )
    three = shapes.union(ONE, OTHER, OTHER.moved((-1.0, 0.0, 0.0)))
    assert three.volume == pytest.approx(1.25, rel=1e-9)


@needs_library
def test_a_body_of_combined_shapes_from_a_config():
    bar = {"shape": {"kind": "box", "size": [1, 0.5, 0.5]}}
    turned = {"rotation": {"axis": [0, 0, 1], "angle": "90 deg"}}
    inner = {"kind": "union", "parts": [bar, {**bar, "pose": turned}]}
    box = {"shape": {"kind": "box", "size": [1, 1, 1]}}
    shape = {"kind": "difference", "parts": [box, {"shape": inner}]}
    config = BodyConfig.model_validate(
        {"shape": shape, "pitch": 0.125, "material": "copper", "temperature": 300}
    )
    # The cross of two bars loses the square that both cover once.
    crossed = 2 * 0.25 - 0.5**3
    assert config.build_mesh().volume == pytest.approx(1.0 - crossed, rel=1e-6)


@needs_library
def test_what_cannot_be_combined():
    with pytest.raises(InputError, match="difference: nothing is left of mesh 0"):
        shapes.difference(OTHER, shapes.box(3.0))
    opened = Mesh(ONE.vertices, ONE.faces[1:], "half a box")
    with pytest.raises(InputError, match=r"mesh 1 \(half a box\) is not closed"):
        shapes.union(ONE, opened)
    with pytest.raises(InputError, match="give two meshes or more, not 1"):
        shapes.union(ONE)


def test_without_the_library_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError) as caught:
        shapes.union(ONE, OTHER)
    assert "needs the package manifold3d" in str(caught.value)
    assert "make env EXTRAS=boolean" in str(caught.value)
    assert "\n" not in str(caught.value)
