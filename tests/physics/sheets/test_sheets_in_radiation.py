"""A shield between two plates halves the radiation between them."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.sheet_bodies import plate
from tests.wall_forms import between_shielded_plates


GREY = jt.Material(50.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
LAYERS = (jt.Layer(GREY, 1e-3),)
SIZE = 0.4
GAP = 2e-4
COLD = 300.0
HEAT_FLUX = 2000.0


def heated_plates(heights):
    """Temperatures of a heated plate, of a cold one, and of others between them [K]."""
    bodies = tuple(
        jt.Body(
            jt.Sheet(plate(SIZE, SIZE), LAYERS, pitch=0.1),
            temperature=350.0,
            pose=jt.Pose((0.0, 0.0, height)),
        )
        for height in heights
    )
    radiating = jt.Face("front", body=0) | jt.Face("back", body=1)
    for number in range(2, len(heights)):
        radiating = radiating | jt.Face("front", body=number)
        radiating = radiating | jt.Face("back", body=number)
    terms = (
        jt.HeatFlux(HEAT_FLUX, on=jt.Face("back", body=0)),
        jt.FixedTemperature(COLD, on=jt.Face("front", body=1)),
        jt.RadiativeExchange(400.0, on=radiating),
    )
    solution = jt.steady(jt.Scene(bodies, terms, dtype="float64"))
    return np.asarray(solution.mean_temperature[0])


@pytest.mark.slow
def test_shield_halves_the_flux_between_two_plates():
    hot, cold = heated_plates([0.0, 2 * GAP])
    screened, held, shield = heated_plates([0.0, 2 * GAP, GAP])
    assert cold == pytest.approx(COLD, abs=0.1)
    assert held == pytest.approx(COLD, abs=0.1)
    # At the same flux the difference of the fourth powers is twice as large.
    ratio = (screened**4 - held**4) / (hot**4 - cold**4)
    assert ratio == pytest.approx(2.0, rel=0.01)
    exact = between_shielded_plates(
        screened,
        held,
        emissivity_hot=0.8,
        emissivity_cold=0.8,
        emissivity_to_hot=0.8,
        emissivity_to_cold=0.8,
    )
    assert exact.heat_flux == pytest.approx(HEAT_FLUX, rel=0.01)
    assert shield == pytest.approx(exact.shield, abs=0.01 * (screened - held))
