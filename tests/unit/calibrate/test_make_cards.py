"""Cards of several bodies and structures: what is fitted, skipped and made again."""

from dataclasses import replace
from pathlib import Path

import pytest

import jaxthermo as jt
from calibrate import make_cards as module
from calibrate.config.loader import calibration_hash, load_calibration
from calibrate.make_cards import make_cards, read_recipes
from jaxthermo.config.card_file import load_card, write_card
from tests.calibrating import SPHERE


BODY = """
scene: ../scene.yaml
set: {bodies.0.voxels_high: 6}
train: [{name: "+x"}]
"""
STRUCTURE = """
set: {bodies.0.structure: {kind: aggregate, factor: 3}}
parameters: [{name: weights.within}]
"""
EXCEPTION = """
exceptions:
  globe:
    set: {bodies.0.voxels_high: 7}
    parameters: [{name: weights.surface, prior: {mean: 1, sd: 0.1}}]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "scene.yaml").write_text(SPHERE)
    for folder_name in ("bodies", "structures"):
        (tmp_path / folder_name).mkdir()
    for body in ("ball", "globe"):
        (tmp_path / "bodies" / f"{body}.yaml").write_text(BODY)
    (tmp_path / "structures" / "blocks.yaml").write_text(STRUCTURE)
    return tmp_path


@pytest.fixture
def fitted(monkeypatch):
    """Names of the cards that were fitted, by a fit that takes no time."""
    names = []
    state = {"ended": "converged"}

    def fit(path, out, overrides, progress, stop, report):
        config = load_calibration(path, overrides)
        names.append(config.name)
        out.mkdir(parents=True, exist_ok=True)
        body = module.scene_config(config, config.train[0].set).bodies[0]
        origin = {"config": calibration_hash(config)}
        weights = jt.ConductionWeights(within=1.5)
        card = jt.FitCard(
            config.name or "",
            body.structure.options,
            weights,
            geometry=dict([body.geometry]),
            origin=origin,
        )
        write_card(out / "card.yaml", card)
        return dict(state)

    monkeypatch.setattr(module, "fit_config", fit)
    return names, state


def made(folder: Path, *names: str, again: bool = False) -> list[str]:
    recipes = read_recipes(folder, names)
    cards = make_cards(
        recipes, out=folder / "out", results=folder / "results", again=again
    )
    return [name for name, _, result in cards if result is not None]


def test_a_recipe_is_the_body_with_the_structure(folder):
    first, _ = read_recipes(folder)
    config = first.load()
    assert config.name == first.name == "ball/blocks"
    assert config.set["bodies.0.voxels_high"] == 6
    assert config.set["bodies.0.structure"] == {"kind": "aggregate", "factor": 3}
    assert [p.name for p in config.parameters] == ["weights.within"]


def test_an_exception_is_for_one_body(folder, fitted):
    """It replaces the parameters, and single values of `set`."""
    path = folder / "structures/blocks.yaml"
    made(folder)
    path.write_text(STRUCTURE + EXCEPTION)
    ball, globe = (recipe.load() for recipe in read_recipes(folder))
    assert [p.name for p in ball.parameters] == ["weights.within"]
    assert [p.name for p in globe.parameters] == ["weights.surface"]
    prior = globe.parameters[0].prior
    assert prior is not None and (prior.mean, prior.sd) == (1, 0.1)
    same = {"bodies.0.structure": {"kind": "aggregate", "factor": 3}}
    assert ball.set == {"bodies.0.voxels_high": 6} | same
    assert globe.set == {"bodies.0.voxels_high": 7} | same
    assert globe.name == "globe/blocks"
    # The cards of the other bodies stay.
    assert made(folder) == ["globe/blocks"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("exceptions: {glob: {}}", "exceptions: there is no body 'glob'; did you mean"),
        ("exceptions: [globe]", "blocks.yaml: exceptions: expected `key: value`"),
        ("exceptions: {globe: 3}", "exceptions: globe: expected `key: value`"),
        ("exceptions: {globe: {set: 3}}", "exceptions: globe: set: expected `key:"),
    ],
)
def test_a_mistake_in_an_exception_is_told(folder, text, message):
    (folder / "structures/blocks.yaml").write_text(STRUCTURE + text)
    with pytest.raises(jt.InputError, match=message):
        read_recipes(folder)


def test_every_card_is_fitted_once(folder, fitted):
    assert made(folder) == ["ball/blocks", "globe/blocks"]
    assert load_card(folder / "out/ball/blocks.yaml").name == "ball/blocks"
    assert made(folder) == []
    assert made(folder, "ball/blocks", again=True) == ["ball/blocks"]


def test_what_changed_or_is_damaged_is_fitted_again(folder, fitted):
    made(folder)
    (folder / "bodies/ball.yaml").write_text(BODY.replace("high: 6", "high: 9"))
    (folder / "out/globe/blocks.yaml").write_text("card: 4\n")
    assert made(folder) == ["ball/blocks", "globe/blocks"]
    # Another geometry of the same name, such as a mesh file with new content.
    scene = SPHERE.replace("kind: sphere, radius", "kind: hemisphere, radius")
    (folder / "scene.yaml").write_text(scene)
    assert made(folder, "ball/blocks") == ["ball/blocks"]


def test_a_card_of_another_name_is_fitted_again(folder, fitted):
    """Even if it says that it was made of this recipe."""
    made(folder)
    path = folder / "out/ball/blocks.yaml"
    write_card(path, replace(load_card(path), name="globe/blocks"))
    assert made(folder) == ["ball/blocks"]
    # And one of another recipe, which has the same geometry.
    path.write_bytes((folder / "out/globe/blocks.yaml").read_bytes())
    assert made(folder) == ["ball/blocks"]


def test_an_interrupted_fit_leaves_no_card(folder, fitted):
    names, state = fitted
    state["ended"] = "interrupted"
    with pytest.raises(KeyboardInterrupt, match="ball/blocks; the same command"):
        made(folder)
    assert not (folder / "out").exists() and names == ["ball/blocks"]


def test_mistakes_are_told_before_anything_is_fitted(folder, fitted):
    with pytest.raises(jt.InputError, match="did you mean 'ball/blocks'"):
        made(folder, "bal/blocks")
    (folder / "bodies/globe.yaml").write_text(BODY.replace("train", "trian"))
    with pytest.raises(jt.InputError, match="globe.yaml: train: missing"):
        made(folder)
    with pytest.raises(jt.InputError, match="has no YAML files"):
        read_recipes(folder / "bodies")
    assert fitted[0] == []
