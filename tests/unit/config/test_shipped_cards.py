"""Cards that are part of the package: named in a scene, listed, and made as said."""

from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.config.loader import calibration_hash, scene_config
from calibrate.make_cards import read_recipes
from calibrate.problem.reference import refined_reference
from calibrate.report.card_list import card_table
from jaxthermo.config.card_file import load_card
from jaxthermo.config.loader import config_hash, load_config, to_yaml
from jaxthermo.config.shipped_cards import FOLDER, card_name, card_path, shipped_cards


ROOT = Path(__file__).resolve().parents[3]
SCENE = ROOT / "configs/scenes/figurine-steel.yaml"
RECIPES = ROOT / "configs/cards"
KIND = "kind: octree"
NAMES = list(shipped_cards())


def scene(card, **context):
    structure = f"bodies.0.structure={{{KIND}, weights: {card}}}"
    return load_config(SCENE, ("bodies.0.voxels_high=12", structure), **context)


@pytest.mark.parametrize("name", NAMES)
def test_a_card_is_a_fit_with_ranges_errors_and_its_origin(name):
    card = load_card(f"card://{name}")
    assert card.name == name and card.tolerance > 1 and len(card.geometry) == 1
    # Cases differ in all numbers, so that no range has zero width.
    assert set(card.ranges) == {"biot", "fourier", "voxels_across", "heating"}
    assert all(0 < low < high for low, high in card.ranges.values())
    # Against finer voxels, whose own error is told.
    errors = card.error_kelvin
    assert card.origin["reference"] == "truth"
    assert all(error["reference"] > 0 for error in errors.values())
    train = errors["train"]
    held_out = errors["held_out"]
    assert train["fitted"] < train["default"]
    # Over all cases, those held out too: weights that only fit are not shipped.

    def largest(which):
        return max(train[which], held_out[which])

    assert 0 < largest("fitted") < largest("default")
    assert {"train", "held_out", "fitted", "nodes", "steps"} <= set(card.origin)
    # The weights that were not fitted are those of the formula.
    fitted = card.origin["fitted"].split("; ")
    formula = vars(jt.ConductionWeights())
    changed = {k for k, v in vars(card.weights).items() if np.any(v != formula[k])}
    assert changed and changed <= {name.removeprefix("weights.") for name in fitted}


@pytest.mark.parametrize("name", NAMES)
def test_a_card_is_what_its_recipe_makes(name, monkeypatch):
    """Or it would have to be made again: `make cards`."""
    monkeypatch.setenv("JAXTHERMO_MESHES", "")
    (recipe,) = read_recipes(RECIPES, [name])
    config = recipe.load()
    card = load_card(f"card://{name}")
    assert card.origin["config"] == calibration_hash(config)
    assert card.surface_cells == config.set["bodies.0.surface_cells"]


def test_every_recipe_has_a_card():
    assert [recipe.name for recipe in read_recipes(RECIPES)] == NAMES
    assert len(NAMES) == 8


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("figurine/")])
def test_a_run_of_the_case_held_out_has_the_error_that_the_card_says(name):
    """The other bodies need files."""
    (recipe,) = read_recipes(RECIPES, [name])
    config = recipe.load()
    card = load_card(f"card://{name}")
    changes = config.held_out[0].set
    weights = {"bodies.0.structure.weights": f"card://{name}"}
    assert config.truth is not None
    reference_config = scene_config(config, changes)
    reference = refined_reference(reference_config, config.truth, lambda stage: None)
    for card_kind, weight_changes in (("default", {}), ("fitted", weights)):
        run_config = scene_config(config, changes, weight_changes)
        solution = jt.simulate(
            run_config.build(),
            run_config.time.end,
            run_config.time.save_times,
            solver=run_config.solver.build(),
        )
        error = jt.truth_error(solution, reference.solution).worst_rms_kelvin
        assert error == pytest.approx(
            card.error_kelvin["held_out"][card_kind], rel=0.05
        )


def test_the_list_has_every_card():
    cards = {name: load_card(path) for name, path in shipped_cards().items()}
    rows = card_table(cards).rows
    assert [row[0] for row in rows] == [f"card://{name}" for name in NAMES]


def test_a_scene_names_a_shipped_card_and_keeps_the_name():
    config = scene("card://figurine/octree")
    fitted = load_card("card://figurine/octree").weights
    weights = config.bodies[0].structure.weights.build()
    np.testing.assert_array_equal(weights.surface_distance, fitted.surface_distance)
    assert "card: card://figurine/octree\n" in to_yaml(config)


def test_the_name_is_read_again_and_the_content_counts(tmp_path, monkeypatch):
    (tmp_path / "kept.yaml").write_text(to_yaml(scene("card://figurine/octree")))
    config = load_config(tmp_path / "kept.yaml")
    path = config.bodies[0].structure.weights.card
    assert path is not None and path == FOLDER / "figurine/octree.yaml"
    assert card_name(path) == "card://figurine/octree"
    copied = tmp_path / "octree.yaml"
    copied.write_bytes(path.read_bytes())
    assert config_hash(scene(str(copied))) == config_hash(config)
    copied.write_text("another")
    assert config_hash(scene(str(copied))) != config_hash(config)


def test_a_card_that_is_not_there_is_told_with_those_that_are():
    with pytest.raises(jt.InputError, match="card://figurin/octree'; did you"):
        scene("card://figurin/octree")
    # As a path, which has lost a slash.
    with pytest.raises(jt.InputError, match="calibrate show --shipped"):
        load_card(Path("card://nothing/known"))
    # The config of a run that was made with another version is still read.
    assert scene("card://gone/octree", find_meshes=False)


def test_a_path_stays_a_path():
    assert card_path("cards/one.yaml") == Path("cards/one.yaml")
    assert card_name(Path("cards/one.yaml")) == "cards/one.yaml"
