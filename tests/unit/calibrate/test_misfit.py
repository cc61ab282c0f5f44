"""What residuals have beyond their noise: closed forms of planted differences."""

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.analysis.identifiability import identify
from calibrate.analysis.judgement import judge_values
from calibrate.analysis.misfit import (
    find_misfit,
    gradient_covariance,
    held_out_differences,
)
from calibrate.analysis.shared_errors import shared_covariance
from calibrate.analysis.verdict import judge
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from calibrate.problem.targets import CaseError
from calibrate.report.text_summary import about_standard_errors
from calibrate.solvers.fit import Fit
from calibrate.solvers.noise_scale import residual_sd
from calibrate.solvers.starts import SearchEnds, load_ends
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.scene.compile.compile import compile_scene
from tests.calibrating import (
    FAST,
    RESULT,
    camera_of_block,
    errors_of,
    seen_block,
    target_of,
)


TIMES = (20.0, 60.0)
WIDTH = 24
BETTER = errors_of([4.0, 3.0], [2.0, 1.0])
COUNT = 2
"""Number of fitted values."""


def _problem(quantity="temperature", kelvin=320.0, times=TIMES):
    scene = seen_block(temperature=350.0, surroundings=220.0)
    view = compute_view(
        compile_scene(scene, 1, 1.0).surfaces,
        scene.terms,
        camera_of_block(WIDTH, WIDTH),
    )
    frames = np.full((len(times), WIDTH, WIDTH), kelvin)
    case = Case(
        name="seen",
        scene=scene,
        run=ParametricRun(times, jt.ForwardEuler(dt=2.0)),
        target=target_of(view, frames, times, quantity),
    )
    names = ("material.conductivity", "material.density")
    fitted = tuple(Parameter(name, (1.0,), 1e-3, 1e3) for name in names)
    return Problem(ParameterSet(fitted), (case,))


@pytest.fixture(scope="module")
def problem():
    """Frames of a block, whose residuals and derivatives are planted."""
    return _problem()


@pytest.fixture(scope="module")
def slopes(problem):
    """Smooth derivatives by two values, as rows, in standard deviations."""
    pixel = np.asarray(problem.cases[0].target.indices[0])
    row, column = np.divmod(pixel, WIDTH)
    early = np.sin(column / 5)
    late = np.cos(row / 7) + column / WIDTH
    return np.stack([np.tile(early, len(TIMES)), np.concatenate([early, late])])


def _left(errors, slopes):
    """What a fit leaves of errors."""
    return errors - slopes.T @ np.linalg.lstsq(slopes.T, errors, rcond=None)[0]


def _found(problem, slopes, errors):
    sd = problem.known_sd
    left = sd * _left(errors, slopes)
    return find_misfit(problem, rows=sd * slopes, residual=left), left


def test_noise_is_alike_in_cases_of_different_numbers_of_pixels(problem):
    fewer = _problem(times=TIMES[:1])
    joint = Problem(problem.parameters, (*problem.cases, *fewer.cases))
    weights = joint.case_weights
    assert sum(weight**2 for weight in weights) == pytest.approx(1.0)
    # Twice and once as many pixels.
    assert weights[0] == pytest.approx(np.sqrt(2) * weights[1])
    for weight, case in zip(weights, joint.cases, strict=True):
        sd = case.target.known_sd
        assert sd is not None
        assert weight * sd == pytest.approx(joint.known_sd)


def test_noise_is_one_in_all_means_and_hardly_ever_differs(problem, slopes):
    rng = np.random.default_rng(1)
    misfits = [
        _found(problem, slopes, rng.standard_normal(slopes.shape[1]))[0]
        for _ in range(300)
    ]
    assert sum(bool(m.differences) for m in misfits) <= 3
    squares = np.mean(
        [[scale["times_noise"] ** 2 for scale in m.scales] for m in misfits], axis=0
    )
    groups = np.array([scale["groups"] for scale in misfits[0].scales])
    # Five standard deviations of the mean over the repeats.
    spread = 5 * np.sqrt(2 / groups / 300)
    assert (np.abs(squares - 1) < spread).all()
    # From single pixels to the whole view, at one time and at both.
    assert groups[0] == slopes.shape[1] and {1, 2} <= set(groups.tolist())


@pytest.mark.parametrize("factor", [1.2, 1.5, 3.0])
def test_larger_noise_widens_errors_and_differs_beyond_what_is_known(
    problem, slopes, factor
):
    noise = np.random.default_rng(2).standard_normal(slopes.shape[1])
    misfit, _ = _found(problem, slopes, factor * noise)
    assert misfit.widening == pytest.approx(factor, rel=0.15)
    assert bool(misfit.differences) is (factor > 1.25)


@pytest.mark.parametrize("through_time", [False, True])
def test_an_offset_of_whole_views_is_the_closed_form(problem, slopes, through_time):
    """Of n pixels alike by b standard deviations: a mean square of 1 + n b^2.

    It is less than the noise of a pixel, and no single pixel shows it.
    """
    rng = np.random.default_rng(3)
    pixels = slopes.shape[1] // len(TIMES)
    signs = np.array([1.0, 1.0 if through_time else -1.0])
    offset = 0.6 * np.repeat(signs, pixels)
    flat = np.zeros_like(slopes)
    flat[0] = rng.standard_normal(slopes.shape[1])
    misfit, _ = _found(problem, flat, offset + rng.standard_normal(len(offset)))
    alike = pixels * (len(TIMES) if through_time else 1)
    expected = np.sqrt(1 + alike * 0.6**2)
    assert misfit.widening == pytest.approx(expected, rel=0.2)
    (words,) = misfit.differences
    assert "means over whole views" in words
    assert ("all times" in words) is through_time


def test_widened_errors_hold_what_alike_residuals_move(problem, slopes):
    """The spread of values over repeated data, which noise alone tells as a fifth."""
    rng = np.random.default_rng(4)
    target = problem.cases[0].target
    squares = target.clusters(edge=8, through_time=True)
    sd = problem.known_sd
    values = []
    errors = []
    for _ in range(200):
        alike = rng.standard_normal(squares.max() + 1)[squares]
        data = alike + 0.5 * rng.standard_normal(slopes.shape[1])
        values.append(np.linalg.lstsq(slopes.T, data, rcond=None)[0])
        misfit, left = _found(problem, slopes, data)
        scatter = gradient_covariance(
            problem, rows=sd * slopes, residual=left, misfit=misfit
        )
        inverse = np.linalg.inv(sd**2 * slopes @ slopes.T)
        errors.append(np.sqrt(np.diag(inverse @ scatter @ inverse)))
    spread = np.std(values, axis=0)
    widened = np.sqrt(np.mean(np.square(errors), axis=0))
    noise = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    assert (noise < 0.3 * spread).all()
    assert (widened > 0.9 * spread).all() and (widened < 3 * spread).all()


def test_a_pixel_that_moves_a_value_is_named(problem, slopes):
    """One without influence is not: the values do not depend on it."""
    errors = np.random.default_rng(5).standard_normal(slopes.shape[1])
    target = problem.cases[0].target
    pixels = slopes.shape[1] // len(TIMES)
    number = pixels + 17
    row, column = divmod(int(target.indices[0][17]), WIDTH)
    errors[number] = 7.0
    steep = slopes.copy()
    steep[:, number] *= 15
    misfit, _ = _found(problem, steep, errors)
    *_, words = misfit.differences
    assert "1 pixel by" in words
    assert f"seen, view 0, row {row}, column {column}, at 60 s" in words
    steep[:, number] = 0
    assert not _found(problem, steep, errors)[0].differences


def test_the_gradient_tells_how_far_the_minimum_is(problem, slopes):
    sd = problem.known_sd
    rows = sd * slopes
    noise = _left(np.random.default_rng(6).standard_normal(slopes.shape[1]), slopes)
    scatter = sd**2 * rows @ rows.T
    covariance = np.linalg.inv(slopes @ slopes.T)
    for away, expected in ((0.1, "fine"), (1.0, "not converged")):
        step = np.array([away * covariance[0, 0] ** 0.5, 0.0])
        judged = identify(
            problem.parameters,
            z=np.zeros(COUNT),
            jacobian=rows,
            sd=sd,
            scatter=scatter,
            residual=sd * (noise + step @ slopes),
        ).verdicts
        assert [v.verdict for v in judged] == [expected, "fine"]
        # Without known noise a part of the loss must be left to gain.
        unknown = identify(
            problem.parameters,
            z=np.zeros(COUNT),
            jacobian=rows,
            sd=residual_sd(sd * noise, COUNT, None),
            residual=sd * (noise + 3 * step @ slopes),
        ).verdicts
        assert unknown[0].verdict == expected


@pytest.mark.parametrize("ended", ["stalled", "at the limit of its steps"])
def test_a_search_that_could_not_go_on_calls_nothing_fine(problem, slopes, ended):
    sd = problem.known_sd
    noise = np.random.default_rng(7).standard_normal(slopes.shape[1])
    fit = Fit(
        z=np.zeros(COUNT),
        loss=1.0,
        initial_loss=1.0,
        residual=sd * _left(noise, slopes),
        jacobian=sd * slopes,
        errors=(),
    )
    for end, expected in (("converged", "fine"), (ended, "not converged")):
        fit.ended = end
        judged = judge_values(problem, fit=fit, uncertainties={}).identified
        assert {v.verdict for v in judged.verdicts} == {expected}


def test_a_search_that_fits_as_well_elsewhere_makes_a_value_ambiguous(problem, slopes):
    """Twice the loss in units of the noise is chi squared: 13.8 for two values."""
    sd = problem.known_sd
    residual = sd * _left(
        np.random.default_rng(7).standard_normal(slopes.shape[1]), slopes
    )
    loss = 0.5 * float(residual @ residual)
    fit = Fit(
        z=np.zeros(COUNT),
        loss=loss,
        initial_loss=1.0,
        residual=residual,
        jacobian=sd * slopes,
        errors=(),
    )
    away = np.array([0.5, 0.0])
    for excess, expected in ((13.0, "ambiguous"), (15.0, "fine")):
        ends = SearchEnds(
            points=np.stack([fit.z, away]),
            losses=np.array([loss, loss + 0.5 * sd**2 * excess]),
        )
        judgement = judge_values(problem, fit=fit, uncertainties={}, ends=ends)
        verdicts = [v.verdict for v in judgement.identified.verdicts]
        assert verdicts == [expected, "fine"]
        value = float(problem.parameters.flat_values(away)[0])
        named = (f"material.conductivity {value:.4g}",)
        assert judgement.elsewhere == (named if expected == "ambiguous" else ())
    words = judge(BETTER, FAST, is_of_weights=False, elsewhere=["k 1.6"])["words"]
    assert "ELSEWHERE" in words and "NOT pay" in words


def test_ends_of_searches_are_read_as_they_were_saved(tmp_path):
    points = np.array([[0.1, 0.2], [0.3, -4.0]])
    ends = SearchEnds(points, losses=np.array([2.0, 1.0]))
    ends.save(tmp_path / "starts.npz")
    stored = load_ends(tmp_path / "starts.npz")
    np.testing.assert_array_equal(stored.points, points)
    np.testing.assert_array_equal(stored.best, points[1])


def test_nothing_is_fine_where_model_and_data_differ(problem, slopes):
    sd = problem.known_sd
    judged = identify(
        problem.parameters,
        z=np.zeros(COUNT),
        jacobian=sd * slopes,
        sd=sd,
        scatter=sd**4 * slopes @ slopes.T,
        doubt="misfit",
    ).verdicts
    assert {v.verdict for v in judged} == {"misfit"}


def test_the_first_words_of_a_verdict_are_on_what_differs():
    verdict = judge(
        BETTER, FAST, is_of_weights=False, differences=["pixels by 3.20 times"]
    )
    assert not verdict["pays"]
    assert verdict["words"].startswith(
        "the fit does NOT pay: the model and the data DIFFER by more than the noise"
    )
    assert "pixels by 3.20 times" in verdict["words"]
    away = judge(BETTER, FAST, is_of_weights=False, away=["material.conductivity"])
    assert not away["pays"] and "AWAY from the minimum" in away["words"]


def test_frames_that_were_held_out_count_too(problem):
    def error(percent):
        percents = (percent, 90.0)
        return {"seen": CaseError(times=TIMES, percent=percents, kelvin=percents)}

    assert held_out_differences(problem, error(110.0)) == ()
    (words,) = held_out_differences(problem, error(400.0))
    assert words == "pixels of seen, held out, by 4.00 times"


@pytest.mark.parametrize("quantity", ["temperature", "radiance"])
def test_a_gain_that_all_pixels_share_moves_values_as_it_moves_the_data(
    quantity, slopes
):
    """All radiances by s: black temperatures by s T / 4, in no residual."""
    problem = _problem(quantity, kelvin=320.0)
    sd = problem.known_sd
    rows = sd * slopes
    covariance = shared_covariance(
        {"gain": 0.02}, problem=problem, z=np.zeros(COUNT), rows=rows
    )
    kelvin = 0.02 * 320.0 / (4 if quantity == "temperature" else 1)
    change = np.full(slopes.shape[1], kelvin / 0.05)
    moved = np.linalg.lstsq(slopes.T, change, rcond=None)[0]
    inverse = np.linalg.inv(rows @ rows.T)
    np.testing.assert_allclose(
        np.sqrt(np.diag(inverse @ covariance @ inverse)), np.abs(moved), rtol=1e-6
    )


def test_what_standard_errors_hold_is_said():
    result = RESULT | {"reference": "frames"}
    text = about_standard_errors(result | {"widening": 1.0, "shared_errors": {}})
    assert "gain_uncertainty" in text and "emissivity_uncertainty" in text
    shared = {"widening": 4.0, "shared_errors": {"gain": 0.02}}
    text = about_standard_errors(result | shared)
    assert "2 % of the gain" in text and "4 times" in text
    assert "gain_uncertainty" not in text and "emissivity_uncertainty" in text
