"""Configs of datasets: shipped ones load, and every mistake is a line."""

from pathlib import Path

import pytest

from jaxthermo.cli.dataset_plan import plan_dataset
from jaxthermo.config.loader import load_dataset, to_yaml
from jaxthermo.errors import InputError


SHIPPED = Path(__file__).resolve().parents[3] / "configs" / "datasets"
SCENE = """
bodies:
  - shape: {kind: box, size: [5 cm, 4 cm, 10 cm]}
    pitch: 1 cm
    material: stainless_steel
    temperature: 300
terms:
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
time: {end: 20, save_at: [5, 20]}
"""
VIEWS = "views: [{position: [1, 0, 0.2], look_at: [0, 0, 0]}]"


@pytest.fixture
def load(tmp_path):
    """Reads a dataset of the small scene from lines of its config."""
    (tmp_path / "scene.yaml").write_text(SCENE)

    def read(*lines):
        path = tmp_path / "set.yaml"
        path.write_text("\n".join(("scene: scene.yaml", *lines)))
        return load_dataset(path)

    return read


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_datasets_have_cameras_that_see_a_body(path, tmp_path):
    config = load_dataset(path)
    plan = plan_dataset(config)
    assert plan.variations and plan.views
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_dataset(again) == config


def test_every_combination_and_every_sample_is_a_run(load):
    config = load(
        VIEWS,
        "variations: {terms.0.temperature: [0 degC, 300], bodies.0.temperature: [310]}",
        "ranges: {terms.0.heat_transfer_coefficient: [5, 20 W/(m^2 K)]}",
        "samples: 3",
        "times: [20]",
    )
    plan = plan_dataset(config)
    assert len(plan.variations) == 6
    key = "terms.0.heat_transfer_coefficient"
    drawn = [float(str(v.changes[key])) for v in plan.variations]
    assert len(set(drawn)) == 6 and all(5 < h < 20 for h in drawn)
    air = [v.config.terms[0].model_dump()["temperature"] for v in plan.variations]
    assert air == [273.15] * 3 + [300.0] * 3
    assert sum(map(plan.frames_of, plan.variations)) == 6
    # The seed decides alone.
    assert plan_dataset(config).digest == plan.digest
    reseeded = plan_dataset(config.model_copy(update={"seed": 1}))
    assert reseeded.digest != plan.digest
    assert reseeded.variations[0].changes != plan.variations[0].changes


def test_cameras_of_an_orbit_keep_to_its_ranges(load):
    orbit = (
        "{count: 40, elevation: [10 deg, 30 deg], distance: [0.5, 60 cm], width: 32, "
        "height: 24}"
    )
    views = plan_dataset(load(f"orbit: {orbit}")).views
    places = [view.position for view in views if view.position is not None]
    lengths = [sum(x * x for x in position) ** 0.5 for position in places]
    assert len(lengths) == 40
    assert min(lengths) >= 0.5 - 1e-5 and max(lengths) <= 0.6 + 1e-5
    sines = [p[2] / d for p, d in zip(places, lengths, strict=True)]
    assert min(sines) > 0.1736 - 1e-4 and max(sines) < 0.5 + 1e-4


def test_frames_have_noise_of_their_own(load):
    config = load(
        "views: [{position: [1, 0, 0.2]}, {position: [0, 1, 0.2]}]",
        "set: {image.effects: [{kind: detector_noise}, {kind: blur, sigma: 1}]}",
    )
    plan = plan_dataset(config)
    noise = [plan.scene(0, view).image.effects[0] for view in (0, 1)]
    seeds = [effect.model_dump()["seed"] for effect in noise]
    assert seeds[0] != seeds[1]
    assert plan.scene(0, 1).image.effects[1] == plan.scene(0, 0).image.effects[1]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "missing `views` or `orbit`"),
        ([VIEWS, "orbit: {count: 2}"], "not several"),
        ([VIEWS, "sampels: 3"], "did you mean 'samples'"),
        ([VIEWS, "samples: 3"], "all samples would be equal"),
        ([VIEWS, "ranges: {terms.0.temperature: [300, 290]}"], "290 is not above 300"),
        ([VIEWS, "ranges: {terms.0.temperature: [300]}"], "[lowest, highest]"),
        ([VIEWS, "ranges: {terms.0.temperature: [3 m, 300]}"], "ranges"),
        ([VIEWS, "low: 300", "high: 300"], "is not above `low`"),
        (["orbit: {count: 2, elevation: [0.5, 0.2]}"], "lowest first"),
        (["orbit: {count: 0}"], "orbit.count"),
        ([VIEWS, "variations: {terms.0.temperature: []}"], "variations"),
    ],
)
def test_mistakes_of_a_dataset(load, lines, words):
    with pytest.raises(InputError) as refused:
        load(*lines)
    assert words in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([VIEWS, "times: [7]"], "7 s is not a saved time"),
        ([VIEWS, "variations: {terms.0.temprature: [280]}"], "did you mean"),
        ([VIEWS, "categories: [one, two]"], "has 1 bodies"),
        (
            ["views: [{}, {position: [1, 0, 0], look_at: [2, 0, 0]}]"],
            "views.1, v0000: camera: at (1.0, 0.0, 0.0) it sees no body",
        ),
        (["views: [{position: [0, 0, 0], look_at: [2, 0, 0]}]"], "inside body 0"),
        ([VIEWS, "set: {bodies.0.pose.translation: [0, 5, 0]}"], "sees no body"),
        (
            ["orbit: {count: 1, look_at: [0, 0, 9], distance: [1, 1]}"],
            "orbit.0, v0000",
        ),
    ],
)
def test_mistakes_that_the_scene_shows(load, lines, words):
    with pytest.raises(InputError) as refused:
        plan_dataset(load(*lines))
    assert words in str(refused.value)
