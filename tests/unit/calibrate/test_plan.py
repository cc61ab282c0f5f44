"""Plans: candidates as scenes, predictions from known laws, and what is refused."""

import math
from pathlib import Path

import pytest

import jaxthermo as jt
from calibrate.plan.candidate import Candidate, cards_of, pitches_of
from calibrate.plan.command import search_time_of, tolerance_of
from calibrate.plan.predict import Measured, Predictor, Size
from calibrate.plan.tolerance import Tolerance
from jaxthermo.config.loader import load_config, to_yaml


ROOT = Path(__file__).resolve().parents[3]
SCENES = ROOT / "configs/scenes"
END = 100.0
VOLUME = 50_000.0
AREA = 8_000.0
SIZE = Size(VOLUME, AREA)


def law(candidate):
    """A run whose error and time follow the model of the predictions."""
    voxels = 0.9 * candidate.refinement**-2.0
    structure = 0.0 if candidate.family == "full_volume" else 0.2 * candidate.size**1.5
    stable = 2.0 * candidate.size**2
    steps = candidate.steps or math.ceil(END / stable)
    in_time = 40.0 * steps**-2.0
    error = math.hypot(voxels, structure, in_time)
    nodes = round(VOLUME / candidate.size**3 + 0.6 * AREA / candidate.size**2)
    stages = max(3, math.ceil((math.sqrt(9 + 16 * END / steps / stable) - 1) / 2))
    time = steps * stages * (3e-5 + 2e-8 * nodes)
    fragments = round(1.5 * AREA * candidate.refinement**2)
    memory = 200 * (nodes + fragments)
    return Measured(
        candidate, error, nodes, fragments, steps, stages, stable, time, memory
    )


def blocks(refinement, factor, steps=36):
    return Candidate(refinement, "aggregate", factor, steps=steps)


def predictor(runs, errors=()):
    return Predictor(runs=runs, errors=errors, end=END, size=SIZE)


KNOWN = [
    law(run)
    for run in (
        *(blocks(1.0, 8), blocks(1.0, 4), blocks(1.0, 8, 12), blocks(2.0, 8)),
        *(blocks(0.5, 4), blocks(2.0, 4)),
    )
]


@pytest.mark.parametrize(
    "candidate", [blocks(2.0, 6, 24), blocks(1.0, 6), blocks(2.0, 10, 18)]
)
def test_a_candidate_between_known_ones_is_predicted(candidate):
    forecast = predictor(KNOWN).forecast(candidate)
    true = law(candidate)
    assert forecast.error == pytest.approx(true.error, rel=0.25)
    assert forecast.run_time == pytest.approx(true.run_time, rel=0.3)
    assert forecast.memory == pytest.approx(true.memory, rel=0.5)


def test_a_run_corrects_the_predictions_nearby_and_not_far_away():
    candidate = blocks(2.0, 6)
    plain = predictor(KNOWN)
    twice = law(candidate)._replace(error=2 * law(candidate).error)
    corrected = predictor([*KNOWN, twice])
    near = candidate._replace(steps=40)
    far = blocks(0.5, 32, 8)

    def ratio(c):
        return corrected.forecast(c).error / plain.forecast(c).error

    assert ratio(near) > 1.3
    assert abs(math.log(ratio(far))) < abs(math.log(ratio(near)))


def test_an_error_without_a_run_counts():
    fine = blocks(2.0, 2, 2000)
    plain = predictor(KNOWN[:3])
    told = predictor(KNOWN[:3], [(fine, law(fine).error)])

    def off(p):
        return abs(math.log(p.forecast(fine).error / law(fine).error))

    assert off(told) < off(plain)


def test_a_candidate_is_a_scene_that_loads_again(tmp_path):
    scene = load_config(SCENES / "mixed-small.yaml")
    pitches = pitches_of(scene)
    assert pitches == pytest.approx((0.3 / 60, 0.005, 0.005), rel=0.01)
    config = Candidate(2.0, "aggregate", 4, steps=30).applied(scene, pitches)
    assert [b.pitch for b in config.bodies] == [p / 2 for p in pitches]
    assert all(b.structure.options["factor"] == 4 for b in config.bodies)
    solver = config.solver.build()
    assert isinstance(solver, jt.SuperTimeStepping) and solver.dt == 900 / 30
    # Bodies touch up to the same gap in all voxels.
    contact = config.terms[2].build()
    assert isinstance(contact, jt.Contact) and contact.threshold == min(pitches)
    path = tmp_path / "scene.yaml"
    path.write_text(to_yaml(config))
    again = load_config(path)
    assert again.model_dump(exclude={"name"}) == config.model_dump(exclude={"name"})


def test_a_body_with_fitted_cards_has_candidates_of_them():
    cards = cards_of(load_config(SCENES / "figurine-steel.yaml"))
    assert {c.card for c in cards} == {"figurine/octree", "figurine/shell-over-core"}
    config = load_config(SCENES / "figurine-steel.yaml")
    scene = cards[0].applied(config, pitches_of(config))
    assert scene.bodies[0].structure.weights.card is not None
    assert cards_of(load_config(SCENES / "mixed-small.yaml")) == ()


def test_the_words_of_a_candidate_name_blocks_voxels_and_steps():
    words = Candidate(2.0, "aggregate", 4, steps=30).words((0.002, 0.002))
    assert words == "blocks of 4 mm from 1 mm voxels, RKL2, 30 steps"
    euler = Candidate(1.0, "octree", method="forward_euler", steps=0).words((0.002,))
    assert euler == "octree of 2 mm voxels, explicit Euler, stable steps"


def test_tolerances_have_units():
    tolerance = tolerance_of("1%", kelvin="200 mK", run_time="10ms", memory="2GB")
    assert tuple(tolerance) == pytest.approx(
        Tolerance(percent=1.0, kelvin=0.2, run_time=0.01, memory=2e9)
    )
    assert tolerance.excess(0.5, 0.3) == pytest.approx(1.5)


def test_a_body_of_given_voxels_has_no_other_pitch():
    scene = load_config(SCENES / "figurine.yaml")
    body = scene.bodies[0].model_copy(
        update={"solid": Path("scan.npy"), "shape": None, "pitch": 0.01}
    )
    with pytest.raises(jt.InputError, match="is given by its voxels"):
        pitches_of(scene.model_copy(update={"bodies": (body,)}))


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("2m", 120.0), ("1.5 m", 90.0), ("2 min", 120.0), ("90", 90.0), ("1h", 3600.0)],
)
def test_the_time_of_a_search_has_a_unit(text, seconds):
    assert search_time_of(text) == pytest.approx(seconds)
    assert search_time_of(None) == math.inf


@pytest.mark.parametrize("text", ["2 mm", "0 s", "-1m", "soon", "m"])
def test_what_is_no_time_of_a_search_is_refused(text):
    with pytest.raises(jt.InputError, match="--search-time"):
        search_time_of(text)
