"""Fit cards: written and read back, used by name, and refused where they do not fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.archive import plain_checksum
from jaxthermo.config.card_file import load_card, write_card
from jaxthermo.config.loader import load_config, to_yaml
from jaxthermo.config.strict_yaml import read_yaml, write_yaml
from jaxthermo.structures.extrapolation import extrapolations
from jaxthermo.structures.weights import FitCard
from tests.bodies import blocks


SCENE = Path(__file__).resolve().parents[3] / "configs/scenes/figurine-steel.yaml"
KIND = {"kind": "shell_over_core", "layers": 1, "factor": 4}


def _card(**weights):
    return FitCard(
        name="one",
        structure=KIND,
        weights=jt.ConductionWeights(**weights),
        ranges={"biot": (0.01, 0.02), "voxels_across": (5.0, 5.0)},
        mechanisms=("sun", "convection"),
        error_percent={"train": {"default": 2.0, "fitted": 1.0}},
        error_kelvin={"train": {"default": 0.5, "fitted": 0.4, "reference": 0.1}},
        surface_cells="crossings",
    )


def test_a_card_comes_back_as_it_was(tmp_path):
    card = _card(within=[1.5, 0.7], between=1.4, nearest_capacity=0.25)
    write_card(tmp_path / "card.yaml", card)
    again = load_card(tmp_path / "card.yaml")
    assert again.structure == KIND
    assert again.ranges == card.ranges
    assert again.error_percent == card.error_percent
    assert again.error_kelvin == card.error_kelvin
    assert again.surface_cells == "crossings"
    for name, value in vars(card.weights).items():
        np.testing.assert_array_equal(vars(again.weights)[name], value)


def test_long_lists_lie_beside_it(tmp_path):
    links = np.linspace(0.5, 2.0, 1000)
    write_card(tmp_path / "card.yaml", _card(links=links))
    assert len((tmp_path / "card.yaml").read_text()) < 2000
    again = np.asarray(load_card(tmp_path / "card.yaml").weights.links)
    np.testing.assert_allclose(again, links, rtol=1e-6)
    (tmp_path / "card.npz").unlink()
    with pytest.raises(jt.InputError, match="keep it beside the card"):
        load_card(tmp_path / "card.yaml")


def test_structures_take_a_card():
    card = _card(within=[1.5, 0.7])
    structure = jt.ShellOverCore(blocks(np.ones((6, 6, 6), bool)), weights=card)
    assert structure.weights is card.weights


def _scene(tmp_path, *changes):
    write_card(tmp_path / "card.yaml", _card(within=[1.5, 0.7]))
    structure = "{kind: shell_over_core, layers: 1, factor: 4, weights: " + str(
        tmp_path / "card.yaml"
    )
    start = f"bodies.0.structure={structure}}}"
    return load_config(SCENE, ("bodies.0.voxels_high=12", start, *changes))


def test_a_scene_names_a_card(tmp_path):
    config = _scene(tmp_path)
    weights = config.build().bodies[0].structure.weights
    np.testing.assert_array_equal(weights.within, [1.5, 0.7])
    written = tmp_path / "kept.yaml"
    written.write_text(to_yaml(config))
    assert load_config(written) == config


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("bodies.0.structure.factor=2", "is of kind shell_over_core, .* factor 4"),
        ("bodies.0.structure.weights.between=2", "give one or the other"),
        ("bodies.0.structure.weights=nowhere.yaml", "there is no file"),
    ],
)
def test_a_card_that_does_not_fit_is_refused(tmp_path, change, message):
    with pytest.raises(jt.InputError, match=message):
        _scene(tmp_path, change).build()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; `calibrate fit` makes fit cards"),
        ("a: 1", "is no fit card: it has no `card`"),
        ("{name: a, structure: {}, weights: {}}", "it has no `card`"),
        (
            "{card: 9, name: a, structure: {}, weights: {}}",
            "version 9, .* reads",
        ),
        (
            "{card: 3, name: a, structure: {}, weights: {}}",
            "version 3, .* reads",
        ),
        ("{card: two, name: a, structure: {}, weights: {}}", "version two, .* reads"),
        ("{card: 4, name: a, structure: {}, weights: {}}", "is cut off"),
        ("{card: 4, name: a, structure: 1, weights: {}, checksum: 1}", "structure: "),
        ("{card: 4, name: a, structure: {}, weights: {}, checksum: 1}", "its checksum"),
        ("{card: 4, name: a, weights: {within: x.npz}, checksum: 1}", "structure: mis"),
        (
            "{card: 4, name: a, structure: {}, weights: {links: a/b}, checksum: 1}",
            "'a/b' is no name of a file",
        ),
    ],
)
def test_what_is_no_card_is_told(tmp_path, text, message):
    path = tmp_path / "card.yaml"
    path.write_text(text)
    with pytest.raises(jt.InputError, match=message) as caught:
        load_card(path)
    assert "\n" not in str(caught.value)


def _lines(folder):
    write_card(folder / "card.yaml", _card(within=[1.5, 0.7]))
    return (folder / "card.yaml").read_text().splitlines(keepends=True)


def test_a_card_that_is_cut_off_anywhere_is_refused(tmp_path):
    lines = _lines(tmp_path)
    for count in range(len(lines)):
        (tmp_path / "cut.yaml").write_text("".join(lines[:count]))
        with pytest.raises(jt.InputError) as caught:
            load_card(tmp_path / "cut.yaml")
        assert "\n" not in str(caught.value)


def test_a_card_that_was_changed_is_refused_but_a_comment_is_not(tmp_path):
    text = "".join(_lines(tmp_path))
    path = tmp_path / "changed.yaml"
    path.write_text("# of the figurine\n" + text)
    np.testing.assert_array_equal(load_card(path).weights.within, [1.5, 0.7])
    path.write_text(text.replace("1.5", "1.6"))
    with pytest.raises(jt.InputError, match="its checksum does not match"):
        load_card(path)


def test_a_card_beside_the_lists_of_another_fit_is_refused(tmp_path):
    (tmp_path / "other").mkdir()
    for folder, last in ((tmp_path, 2.0), (tmp_path / "other", 3.0)):
        write_card(folder / "card.yaml", _card(links=np.linspace(0.5, last, 100)))
    (tmp_path / "other" / "card.npz").replace(tmp_path / "card.npz")
    with pytest.raises(jt.InputError, match="its checksum does not match"):
        load_card(tmp_path / "card.yaml")


def test_a_card_with_weights_that_this_version_does_not_have(tmp_path):
    """Written by another version, with a checksum that is right."""
    plain = {"card": 4, "name": "one", "structure": KIND, "weights": {"inside": 2.0}}
    path = tmp_path / "card.yaml"
    path.write_text(write_yaml({**plain, "checksum": plain_checksum(plain)}))
    with pytest.raises(jt.InputError, match="weights: .*inside"):
        load_card(path)
    plain["weights"] = {"within": -2.0}
    path.write_text(write_yaml({**plain, "checksum": plain_checksum(plain)}))
    with pytest.raises(jt.InputError, match="at least 0"):
        load_card(path)


def test_a_scene_outside_the_fitted_range_is_told():
    card = _card()
    inside = {"biot": 0.021, "voxels_across": 5.5}
    assert extrapolations(card, inside, ("sun",)) == []
    remarks = extrapolations(card, {"biot": 0.5, "voxels_across": 2.0}, ("sun", "wind"))
    assert [line.split()[0] for line in remarks] == ["biot", "voxels", "wind:"]


def test_a_range_without_width_says_its_tolerance():
    (line,) = extrapolations(_card(), {"voxels_across": 2.0}, ())
    assert "fitted at 5 only (a factor of 1.2 beyond counts as inside)" in line
    card = replace(_card(), tolerance=3.0)
    assert extrapolations(card, {"voxels_across": 2.0}, ()) == []


def test_another_geometry_is_told_and_a_renamed_file_is_not():
    card = replace(_card(), geometry={"buddha.obj": "0123"})
    assert extrapolations(card, {}, (), ("statue.obj", "0123")) == []
    (line,) = extrapolations(card, {}, (), ("bunny.obj", "4567"))
    assert line == "geometry bunny.obj: the card was fitted on buddha.obj"
    (line,) = extrapolations(card, {}, (), ("buddha.obj", "4567"))
    assert "with another content" in line
    # Cards of a version that did not store it.
    assert extrapolations(_card(), {}, (), ("bunny.obj", "4567")) == []


def test_other_surface_cells_are_told():
    """Weights make up for the errors of the surface that they were fitted with."""
    assert extrapolations(_card(), {}, (), None, "crossings") == []
    (line,) = extrapolations(_card(), {}, (), None, "dominant_axis")
    assert line == "surface_cells dominant_axis: the card was fitted with crossings"
    unknown = replace(_card(), surface_cells="")
    assert extrapolations(unknown, {}, (), None, "dominant_axis") == []


def _geometry(*changes):
    return load_config(SCENE, changes).bodies[0].geometry


def test_the_geometry_of_a_body_is_its_content_without_the_scale(tmp_path):
    shape = _geometry()
    assert shape[0] == "figurine"
    assert _geometry("bodies.0.shape.height=3 m", "bodies.0.voxels_high=9") == shape
    box = "bodies.0.shape={{kind: box, size: [{}]}}".format
    assert _geometry(box("1, 2, 3")) == _geometry(box("0.2, 0.4, 0.6"))
    assert _geometry(box("1, 2, 3")) != _geometry(box("1, 2, 4"))
    files = [tmp_path / name for name in ("a.npy", "b.npy", "c.npy")]
    for path, filled in zip(files, (True, True, False), strict=True):
        np.save(path, np.full((2, 2, 2), filled))
    data = read_yaml(SCENE)
    del data["bodies"][0]["shape"], data["bodies"][0]["voxels_high"]
    messages = []
    for path in files:
        data["bodies"][0] |= {"solid": str(path), "pitch": 1.0}
        (tmp_path / "scene.yaml").write_text(write_yaml(data))
        messages.append(load_config(tmp_path / "scene.yaml").bodies[0].geometry)
    assert [name for name, _ in messages] == ["a.npy", "b.npy", "c.npy"]
    assert messages[0][1] == messages[1][1] != messages[2][1]
