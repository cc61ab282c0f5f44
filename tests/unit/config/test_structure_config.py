"""Structures and surface maps in a config: read, refused with one line, and built."""

from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import config_hash, load_config, resolved, to_yaml
from jaxthermo.config.schema.structure import (
    FluxCorrectedMap,
    FullVolume,
    _ConstantMap,
    _LinearMap,
    _Octree,
    _WeightsConfig,
)
from jaxthermo.config.types.files import read_labels
from jaxthermo.errors import InputError


SCENE = """
bodies:
  - shape: {{kind: box, size: [0.12, 0.12, 0.12]}}
    pitch: 1 cm
    material: copper
    temperature: 20 degC
    {lines}
time: {{end: 60, save_at: [60]}}
"""

TAKES = {
    "full_volume": {"kernels"},
    "single_shell": {"capacity"},
    "multi_level": {"levels", "hollow"},
    "irregular_multi_level": {"levels", "keep_capacity"},
    "octree": {"levels"},
    "aggregate": {"factor", "nodes", "size", "min_time_constant", "alignment"},
    "shell_over_core": {"layers", "factor"},
    "partition": {"labels"},
}
KEYS = sorted(set.union(*TAKES.values()))


@pytest.fixture
def body(tmp_path):
    """A function from lines of a body, and overrides, to the body's config."""

    def load(lines: str = "", *overrides: str):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(lines=lines))
        return load_config(path, overrides).bodies[0]

    return load


@pytest.fixture
def refused(body):
    """A function from lines of a body, and overrides, to the one line of refusal."""

    def load(lines: str = "", *overrides: str) -> str:
        with pytest.raises(InputError) as caught:
            body(lines, *overrides)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    return load


def test_without_either_it_is_the_full_volume_read_at_the_surface(body):
    config = body()
    assert config.structure == FullVolume()
    assert config.surface_map == FluxCorrectedMap(at="surface")


@pytest.mark.parametrize("name", sorted(set(TAKES) - {"partition"}))
def test_a_kind_may_be_written_short(body, name):
    long = body(f"structure: {{kind: {name}}}").structure
    assert long.kind == name
    assert body(f"structure: {name}").structure == long


@pytest.mark.parametrize(
    "lines", ["", "structure: aggregate", "structure: {kind: octree}"]
)
@pytest.mark.parametrize(
    "override", ["bodies.0.structure.kind=octree", "bodies.0.structure=octree"]
)
def test_a_kind_may_be_set(body, lines, override):
    assert body(lines, override).structure == _Octree()


@pytest.mark.parametrize(
    "lines", ["structure: octree", "structure: {kind: octree, weights: {between: 0.5}}"]
)
def test_a_weight_may_be_set(body, lines):
    structure = body(lines, "bodies.0.structure.weights.between=0.9").structure
    assert structure == _Octree(weights=_WeightsConfig(between=0.9))
    within = body(lines, "bodies.0.structure.weights.within=[1, 90 %]").structure
    assert within.weights.within == (1.0, 0.9)


def test_a_weight_of_no_structure_is_of_the_full_volume(body):
    structure = body("", "bodies.0.structure.weights.within=0.9").structure
    assert structure == FullVolume(weights=_WeightsConfig(within=0.9))


def test_kernels_of_the_full_volume_are_no_part_of_what_a_card_is_fitted_to(body):
    grid = jt.voxelize(jt.shapes.box((0.02, 0.02, 0.02)), 0.01)
    structure = body("structure: {kind: full_volume, kernels: numba}").structure
    assert structure.build(grid).kernels == "numba"
    assert structure.options == body("structure: full_volume").structure.options


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("surface_map: constant", _ConstantMap()),
        ("surface_map: linear", _LinearMap()),
        ("surface_map: {kind: linear, at: voxel}", _LinearMap(at="voxel")),
        ("surface_map: {at: voxel}", FluxCorrectedMap(at="voxel")),
    ],
)
def test_surface_maps(body, lines, expected):
    config = body(lines).surface_map
    assert config == expected
    built = config.build()
    assert type(built).__name__ == type(expected).__name__.lstrip("_")
    assert getattr(built, "at", None) == getattr(expected, "at", None)


@pytest.mark.parametrize(
    ("name", "key"),
    [(name, key) for name, keys in TAKES.items() for key in KEYS if key not in keys],
)
def test_the_key_of_another_kind_is_one_line_with_what_this_kind_takes(
    tmp_path, refused, name, key
):
    np.save(tmp_path / "a.npy", np.zeros((1, 1, 1), int))
    labels = ", labels: a.npy" if name == "partition" else ""
    line = refused(f"structure: {{kind: {name}{labels}, {key}: 3}}")
    location, explanation = line.split("unknown key: ")
    assert location.endswith(f"scene.yaml: bodies.0.structure.{key}: ")
    takes = explanation.removeprefix(f"{name} takes ").split(", ")
    assert set(takes) == TAKES[name] | {"weights"}


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("structure: octre", "structure.kind: unknown kind 'octre'; did .* 'octree'"),
        ("structure: 3", "structure: expected a mapping with a `kind`, got 3"),
        ("structure: [octree]", "structure: expected a mapping with a `kind`"),
        ("structure: {kind: octree, levels: 0}", "levels: must be at least 1, got 0"),
        ("structure: {kind: octree, levels: 2.5}", "levels: expected a whole number"),
        ("structure: {kind: aggregate, factor: 0}", "factor: must be at least 1"),
        ("structure: {kind: aggregate, factor: 5000}", "factor: must be at most 4096"),
        (
            "structure: {kind: aggregate, factor: 4, size: 8 mm}",
            "structure.size: give `factor`, `nodes` or `size`, one of them",
        ),
        ("structure: {kind: aggregate, nodes: 0}", "nodes: must be at least 1, got 0"),
        ("structure: {kind: aggregate, size: 3 s}", "structure.size: .* a length"),
        ("structure: {kind: aggregate, size: 0}", "size: must be more than 0"),
        ("structure: {weights: {within: 1e300}}", "within: must be at most 1e.09"),
        ("structure: {kind: shell_over_core, layers: 0}", "layers: must be at least 1"),
        ("structure: {kind: multi_level, hollow: full}", "hollow: 'full' is not known"),
        ("structure: {kind: single_shell, capacity: 1}", "capacity: 1 is not known"),
        (
            "structure: {kind: irregular_multi_level, keep_capacity: 1}",
            "keep_capacity: expected true or false",
        ),
        ("structure: {weights: {betwen: 1}}", "did you mean 'between'"),
        ("structure: {weights: {within: -1}}", "weights.within: must be at least 0"),
        ("structure: {weights: {within: [1, -1]}}", "within.1: must be at least 0"),
        ("structure: {weights: {within: []}}", "weights.within: must not be empty"),
        ("structure: {weights: {within: .nan}}", "weights.within: must be finite"),
        ("structure: {weights: {capacity: [1, 0]}}", "capacity.1: must be more than 0"),
        (
            "structure: {weights: {surface: [1, 1]}}",
            "weights.surface: expected a number",
        ),
        ("structure: {weights: 2}", "weights: expected `key: value` lines, got 2"),
        ("structure: partition", "structure.labels: missing"),
        (
            "structure: {kind: partition, labels: a.npy}",
            "labels: there is no file 'a.npy'",
        ),
        (
            "surface_map: lineal",
            "surface_map.kind: unknown kind 'lineal'; did .*linear",
        ),
        (
            "surface_map: {kind: constant, at: voxel}",
            "surface_map.at: unknown key: constant",
        ),
        ("surface_map: {at: node}", "surface_map.at: 'node' is not known"),
    ],
)
def test_each_mistake_is_one_line_with_its_path(refused, lines, message):
    with pytest.raises(InputError, match=message):
        raise InputError(refused(lines))


def test_written_out_it_loads_to_the_same(tmp_path):
    path = tmp_path / "scene.yaml"
    weights = "weights: {within: [1, 0.5], capacity: 2}"
    structure = f"structure: {{kind: shell_over_core, layers: 2, {weights}}}"
    path.write_text(SCENE.format(lines=structure + "\n    surface_map: linear"))
    config = load_config(path)
    path.write_text(to_yaml(config))
    assert load_config(path) == config


def test_labels_are_found_like_meshes_and_count_with_their_content(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path / "shelf"))
    (tmp_path / "shelf").mkdir()
    path = tmp_path / "scene.yaml"
    lines = "structure: {kind: partition, labels: a.npy}"
    path.write_text(SCENE.format(lines=lines))
    hashes = []
    for folder, label in (("shelf", 1), (".", 1), (".", 2)):
        file = tmp_path / folder / "a.npy"
        np.save(file, np.full((2, 2, 2), label))
        config = load_config(path)
        labels = Path(resolved(config)["bodies"][0]["structure"]["labels"])
        assert labels == file.resolve()
        hashes.append(config_hash(config))
    assert hashes[0] == hashes[1] != hashes[2]


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (np.zeros((2, 2), int), r"expected whole numbers .* int64 of shape \[2, 2\]"),
        (np.zeros((2, 2, 2)), r"expected whole numbers .* float64"),
        (np.full((2, 2, 2), None), "not an array of numbers"),
        (b"", "not an array of numbers"),
        (b"junk" * 99, "not an array of numbers"),
        (b"\x93NUMPY\x01\x00\x76\x00{'descr': '<i8', 'shape': (9**9,", "not an array"),
        (None, "cannot be read: no such file"),
    ],
)
def test_labels_that_are_none(tmp_path, labels, message):
    path = tmp_path / "a.npy"
    if isinstance(labels, bytes):
        path.write_bytes(labels)
    elif labels is not None:
        np.save(path, labels, allow_pickle=True)
    with pytest.raises(InputError, match=message) as caught:
        read_labels(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_the_labels_of_another_body(tmp_path, body):
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), int))
    config = body("structure: {kind: partition, labels: a.npy}")
    with pytest.raises(InputError) as caught:
        config.build()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "make", "default"),
    [
        ("full_volume", jt.FullVolume, None),
        ("single_shell, capacity: own", lambda g: jt.SingleShell(g, "own"), None),
        (
            "multi_level, levels: 2, hollow: innermost",
            lambda g: jt.MultiLevel(g, 2, hollow="innermost"),
            jt.MultiLevel,
        ),
        (
            "irregular_multi_level, levels: 1, keep_capacity: true",
            lambda g: jt.IrregularMultiLevel(g, 1, keep_capacity=True),
            jt.IrregularMultiLevel,
        ),
        ("octree, levels: 1", lambda g: jt.Octree(g, 1), jt.Octree),
        ("aggregate, factor: 3", lambda g: jt.Aggregate(g, 3), jt.Aggregate),
        (
            "shell_over_core, layers: 2, factor: 3",
            lambda g: jt.ShellOverCore(g, 2, 3),
            jt.ShellOverCore,
        ),
    ],
    ids=lambda value: value.split(",")[0] if isinstance(value, str) else "",
)
def test_each_kind_is_built_as_the_config_says(body, options, make, default):
    weights = "weights: {surface: 0.5, surface_distance: 2, non_orthogonal: 0.5}"
    config = body(
        f"structure: {{kind: {options}, {weights}}}", "bodies.0.surface_map=constant"
    )
    built = config.build()
    structure = built.structure
    expected = make(structure.grid)
    assert type(structure) is type(expected)
    assert (structure.node_count, structure.link_count, structure.capacity_ratio) == (
        expected.node_count,
        expected.link_count,
        expected.capacity_ratio,
    )
    if default is not None:
        assert structure.node_count != default(structure.grid).node_count
    assert structure.weights == jt.ConductionWeights(
        surface=0.5, surface_distance=2.0, non_orthogonal=0.5
    )
    assert isinstance(built.surface_map, jt.ConstantMap)


@pytest.mark.parametrize(
    ("option", "factor"),
    [("nodes: 64", 3), ("nodes: 63", 4), ("size: 3 cm", 3), ("size: 2.4 cm", 2)],
)
def test_nodes_or_a_size_choose_the_factor(body, option, factor):
    config = body(f"structure: {{kind: aggregate, {option}}}")
    assert config.structure.factor is None
    structure = config.build().structure
    assert structure.factor == factor
    assert structure.node_count == (12 // factor) ** 3
    # A card names the factor, and fits whatever chose it.
    fixed = body(f"structure: {{kind: aggregate, factor: {factor}}}").structure
    assert config.structure.options_of(structure) == fixed.options


def test_a_block_of_less_than_a_voxel_is_refused(body):
    config = body("structure: {kind: aggregate, size: 9 mm}")
    with pytest.raises(InputError, match=r"size=0.009.*a voxel, 0.01 m") as caught:
        config.build()
    assert "\n" not in str(caught.value)


def test_a_partition_has_a_node_for_each_label(tmp_path, body):
    labels = np.zeros((12, 12, 12), int)
    labels[6:] = 7
    labels[:, :, 9:] = 3
    np.save(tmp_path / "a.npy", labels)
    built = body("structure: {kind: partition, labels: a.npy}").build()
    assert isinstance(built.structure, jt.Partition)
    assert built.structure.node_count == 3
    assert built.structure.capacity_ratio == pytest.approx(1)
