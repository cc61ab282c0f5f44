"""Receipts warn of cells that are too coarse for what happens first."""

import re
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.scene.compile.penetration import _losses
from tests.bodies import bar, single_body_scene
from tests.physics.test_skin import HOUR, SUN, half_space


END = jt.Side((-1.0, 0.0, 0.0))
GROUND = jt.Material(1.0, density=2000.0, specific_heat=1000.0, emissivity=1.0)
FURNACE = jt.Surroundings(1200.0, on=END)
ESTIMATE = re.compile(r"about (\S+) K at (\S+) s.* until (\S+) s")


def warnings_of(structure, save_times, *terms, material: Any = GROUND):
    scene = single_body_scene(
        structure, material, 300.0, *terms, allow_extreme_temperatures=True
    )
    compiled = jt.compile_scene(scene, end=save_times[-1], save_times=save_times)
    return [line for line in compiled.receipt.warnings if "heat has gone" in line]


class Case(NamedTuple):
    """Loads on a half space, and the cells that it is divided into."""

    pitch: float
    conductivity: float
    heat_capacity: float
    save_times: tuple[float, ...]
    heat_flux: Any = 0.0
    coefficient: float = 0.0
    surroundings: float = 0.0

    @property
    def material(self) -> jt.Material:
        density = self.heat_capacity / 1000.0
        return jt.Material(
            self.conductivity, density=density, specific_heat=1000.0, emissivity=1.0
        )

    @property
    def terms(self):
        terms = (
            jt.HeatFlux(self.heat_flux, on=END),
            jt.Convection(self.coefficient, 300.0, on=END),
        )
        if self.surroundings:
            return (*terms, jt.Surroundings(self.surroundings, on=END))
        return terms

    def error(self):
        """Error of the surface at the saved times [K]."""
        grid = bar(15, self.pitch)
        scene = single_body_scene(
            jt.FullVolume(grid),
            self.material,
            300.0,
            *self.terms,
            allow_extreme_temperatures=True,
        )
        with pytest.warns(UserWarning, match="heat has gone"):
            solution = jt.simulate(scene, self.save_times[-1], save_at=self.save_times)
        end = np.argmin(grid.fragment_normal[:, 0])
        count = len(self.save_times)
        rise = np.asarray(solution.surface_temperature)[-count:, end] - 300.0
        return rise - self.right()

    def right(self):
        """Rise of the surface of the half space at the saved times [K]."""

        def load(theta, time):
            flux = self.heat_flux
            if isinstance(flux, jt.Table):
                flux = np.interp(time, flux.times, flux.values)
            flux = flux - self.coefficient * theta
            slope = -self.coefficient - 1e-9
            if self.surroundings:
                kelvin = theta + 300.0
                flux += STEFAN_BOLTZMANN * (self.surroundings**4 - kelvin**4)
                slope -= 4 * STEFAN_BOLTZMANN * kelvin**3
            return flux, slope

        first = self.save_times[0]
        depth = np.sqrt(self.conductivity / self.heat_capacity * first)
        thickness = depth / 10 * 1.06 ** np.arange(140)
        return half_space(
            self.material, thickness, load, self.save_times, dt=first / 40
        )


DAY = tuple(np.arange(1, 25) * HOUR)

CASES = {
    "furnace": Case(0.02, 1.0, 2e6, (1.0, 10.0, 40.0), surroundings=1200.0),
    "fine furnace": Case(0.002, 1.0, 2e6, (1.0, 10.0, 40.0), surroundings=1200.0),
    "late furnace": Case(0.02, 1.0, 2e6, (40.0, 80.0), surroundings=900.0),
    "quenched": Case(0.02, 1.0, 2e6, (5.0, 50.0), coefficient=60.0, heat_flux=2e4),
    "plastic": Case(
        0.005, 0.2, 1.5e6, (60.0, 300.0), coefficient=10.0, heat_flux=800.0
    ),
    "metal": Case(0.02, 50.0, 4e6, (1.0, 2.0, 5.0), heat_flux=3e5),
    "cooled": Case(0.02, 1.4, 2e6, (60.0, 600.0), coefficient=5.0, heat_flux=-1e3),
    "roof": Case(
        0.5,
        1.4,
        2300.0 * 880.0,
        DAY,
        coefficient=12.0,
        heat_flux=SUN,
    ),
}


# The others take as long to compile as these.
DEFAULT = {"furnace", "metal", "roof"}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=name, marks=() if name in DEFAULT else pytest.mark.slow)
        for name, case in CASES.items()
    ],
)
def test_the_estimate_is_the_error_that_fine_cells_show(case):
    lines = warnings_of(
        jt.FullVolume(bar(15, case.pitch)),
        case.save_times,
        *case.terms,
        material=case.material,
    )
    assert len(lines) == 1
    (numbers,) = ESTIMATE.findall(lines[0])
    estimate, worst, latest = map(float, numbers)
    error = np.abs(case.error())
    assert error.max() / 1.2 < estimate < error.max() * 1.2
    # The error at the stated time is not far below the largest.
    assert error[case.save_times.index(worst)] > error.max() / 1.2
    assert latest in case.save_times


STEEL = jt.Layer("stainless_steel", 0.8e-3)
WOOD = jt.Layer(jt.Material(0.12, density=500.0, specific_heat=1600.0), 0.02)


@pytest.mark.parametrize(
    ("structure", "save_times", "term"),
    [
        (jt.Skin(jt.FullVolume(bar(4, 0.02)), on=END), (1.0, 60.0), FURNACE),
        (jt.FullVolume(bar(4, 0.0005)), (1.0, 60.0), FURNACE),
        (jt.FullVolume(bar(4, 0.02)), (3600.0,), FURNACE),
        (
            jt.FullVolume(bar(4, 0.02)),
            (60.0, 7200.0),
            jt.HeatFlux(jt.Table([0.0, 7200.0], [0.0, 400.0]), on=END),
        ),
        (jt.FullVolume(bar(4, 0.02)), (1.0, 60.0), jt.HeatFlux(20.0, on=END)),
        (jt.FullVolume(bar(4, 0.02)), (0.0,), FURNACE),
    ],
    ids=["skin", "fine cells", "late", "slow", "weak", "start alone"],
)
def test_no_line_where_the_error_is_small(structure, save_times, term):
    assert warnings_of(structure, save_times, term) == []


def test_no_line_on_thin_walls_that_are_isothermal_through_their_cells():
    # Heat reaches their far side, and Biot numbers are 1e-3.
    copper = jt.Material(400.0, density=8900.0, specific_heat=385.0)
    sun = jt.HeatFlux(1e3, on=END)
    plate = jt.FullVolume(bar(1, 0.005))
    assert warnings_of(plate, (0.01, 60.0), sun, material=copper) == []
    sheet = jt.Sheet(jt.shapes.box((1.0, 0.5, 0.5)), (STEEL,), pitch=0.25)
    sun = jt.HeatFlux(1e3, on=jt.Face("front"))
    assert warnings_of(sheet, (0.01, 60.0), sun, material=None) == []


def test_a_sheet_of_few_cells_is_told_to_have_more():
    panel = jt.shapes.box((1.0, 0.5, 0.5))
    sun = jt.HeatFlux(800.0, on=jt.Face("front"))
    coarse = jt.Sheet(panel, (WOOD, STEEL), pitch=0.25, cells=2)
    (line,) = warnings_of(coarse, (60.0,), sun, material=None)
    assert "less than its cells of" in line
    assert "give more `cells` through it" in line
    fine = jt.Sheet(panel, (WOOD, STEEL), pitch=0.25)
    assert warnings_of(fine, (60.0,), sun, material=None) == []


def test_only_the_body_that_is_too_coarse_is_named():
    fine, coarse = (
        jt.Body(jt.FullVolume(bar(4, pitch)), GROUND, temperature=300.0, pose=pose)
        for pitch, pose in (
            (0.0005, jt.Pose()),
            (0.02, jt.Pose((0.0, 1.0, 0.0))),
        )
    )
    scene = jt.Scene((fine, coarse), (jt.HeatFlux(3e3),))
    (line,) = jt.compile_scene(scene, end=1.0, save_times=(1.0,)).receipt.warnings
    assert line.startswith(
        "body 1: 1 s after a change of its loads heat has gone 0.71 mm"
    )
    remedy = "give it a skin (`skin: {cells: 10}`) or a finer pitch, or save later"
    assert remedy in line


def test_materials_of_the_same_structure_have_their_own_lines():
    wood = jt.Material(0.2, density=600.0, specific_heat=1600.0, emissivity=1.0)
    structure = jt.FullVolume(bar(4, 0.02))
    load = jt.HeatFlux(3e3, on=END)
    lines = [
        warnings_of(structure, (1.0,), load, material=material)
        for material in (GROUND, wood, jt.MaterialMap(wood))
    ]
    assert lines[0] != lines[1] == lines[2]
    new = jt.FullVolume(bar(4, 0.02))
    assert warnings_of(new, (1.0,), load, material=wood) == lines[1]


def test_a_sudden_load_late_in_a_run_is_seen():
    table = jt.Table([0.0, 3600.0, 3601.0, 3660.0], [0.0, 0.0, 4e3, 4e3])
    sudden = jt.HeatFlux(table, on=END)
    structure = jt.FullVolume(bar(4, 0.02))
    (line,) = warnings_of(structure, (3600.0, 3610.0, 3660.0), sudden)
    assert "10 s after a change of its loads" in line
    assert "K at 3610 s" in line


def test_the_initial_state_may_be_a_function_of_position():
    def temperature(points):
        return 300.0 + 0.0 * points[:, 0]

    body = jt.Body(
        jt.FullVolume(bar(15, 0.02)),
        jt.MaterialMap(GROUND),
        temperature=temperature,
    )
    scene = jt.Scene((body,), (FURNACE,), allow_extreme_temperatures=True)
    (line,) = jt.compile_scene(scene, end=1.0, save_times=(1.0,)).receipt.warnings
    assert "off by about 5.8e+02 K at 1 s" in line


def test_nothing_is_estimated_where_numbers_are_traced():
    def warned(flux):
        lines = warnings_of(
            jt.FullVolume(bar(4, 0.02)), (1.0, 60.0), jt.HeatFlux(flux, on=END)
        )
        assert lines == []
        return flux

    jax.eval_shape(warned, jnp.asarray(4e3))
    jax.eval_shape(lambda _: warned(4e3), jnp.asarray(0.0))


def test_losses_of_all_fragments_follow_from_their_drives():
    """D = D_0 - b E, and at the surface D = E: D_0 = (1 + b) E."""
    loss = np.array([0.0, 0.03, 1.0, 40.0, 1e4])
    without_loss = np.array([3.0, -200.0, 1e-3, 50.0, -7.0])
    asked = np.array([4, 0, 2, 1])
    losses = _losses(
        lambda above: without_loss - loss * above, without_loss, fragments=asked
    )
    expected = np.maximum(loss, 1e-3)[asked]
    np.testing.assert_allclose(1 + losses, 1 + expected, rtol=2e-3)
