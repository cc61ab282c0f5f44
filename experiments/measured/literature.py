"""Cases whose measured numbers are from the literature; none of them is fitted."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from jaxthermo.constants import ZERO_CELSIUS

from ..harness.case import Check, Group, case, near
from . import convection, ground, heated_plate, moon
from .folds import rms


# Handbooks give correlations of convection this accuracy.
_CORRELATION = 0.25


def _largest(comparisons: Iterable[convection.Comparison]) -> float:
    """The deviation farthest from 0 [%]."""
    return 100 * max((c.deviation for c in comparisons), key=abs)


def _deviation(
    name: str, comparisons: Callable[[], Iterable[convection.Comparison]]
) -> Check:
    limit = 100 * _CORRELATION
    computed = _largest(comparisons())
    return Check(name, computed, highest=limit, lowest=-limit, unit="%")


@case(
    "still air",
    title="warm cylinders in still air",
    source="Griffiths and Davis 1922; Morgan 1975",
    requirement="25 %, the accuracy of such correlations",
    method="laws alone, ten bodies from 1 mm to 2.6 m",
)
def _still_air() -> Iterator[Check]:
    yield _deviation("upright cylinders", convection.upright_cylinders)
    yield _deviation("lying cylinders", convection.lying_cylinders)


@case(
    "wind",
    title="warm cylinders and spheres in wind",
    source="Kramers 1946",
    requirement="25 %, the accuracy of such correlations; spheres reported",
    method="laws alone, bodies of 2 and 10 mm",
)
def _wind() -> Iterator[Check]:
    yield _deviation("cylinders", convection.cylinders_in_wind)
    # Whitaker's spheres have less than Kramers': a known difference of measurements.
    computed = _largest(convection.spheres_in_wind())
    yield near("spheres", computed, 0.0, unit="%")


@case(
    "ground",
    title="ground of a high desert, a clear day in winter",
    source="NOAA SURFRAD, Alamosa, 1 January 2016, in the repository of pvlib",
    requirement="4 K rms over the day",
    method="stack `soil`, the fourth of equal days, steps of 15 min",
)
def _ground() -> Iterator[Check]:
    errors = ground.errors("soil")
    yield Check("rms over the day", rms(errors), highest=4.0, unit="K")
    yield near("bias over the day", float(np.mean(errors)), 0.0, unit="K")


@case(
    "moon",
    title="the Moon's day at the equator, and Apollo's probes in the ground",
    source="Diviner and Apollo, in Hayne et al. 2017, JGR Planets 122, 2371",
    requirement="5 K at the equator, their uncertainty; Apollo reported",
    method="columns of 4 mm, 40 lunations of 720 steps",
)
def _moon() -> Iterator[Check]:
    equator, apollo_15, apollo_17 = moon.last_days()
    uncertainty = moon.UNCERTAINTY
    for name, computed, measured in (
        ("noon", equator.surface[0], moon.NOON),
        ("midnight", equator.after_noon(np.array(12.0)), moon.MIDNIGHT),
        ("least", equator.surface.min(), moon.LEAST),
    ):
        yield near(name, float(computed), measured, unit="K", tolerance=uncertainty)
    hours, night = moon.NIGHT.T
    errors = equator.after_noon(hours) - night
    yield Check("rms by night", rms(errors), highest=uncertainty, unit="K")
    means = (
        apollo_15.surface_mean,
        apollo_15.ground_mean,
        apollo_17.surface_mean,
        apollo_17.ground_mean,
    )
    for (name, measured), computed in zip(
        moon.APOLLO_MEANS.items(), means, strict=True
    ):
        yield near(name, computed, measured, unit="K")


@case(
    "heated plate",
    title="metal plate on wool under a radiant heater, then in still air",
    source="NIST, plate thermometers in firemodels/exp",
    requirement="steady within 5 % of the rise; heating and cooling reported",
    method="voxels of 3.2 mm, steps of 2.5 s",
)
def _heated_plate() -> Iterator[Check]:
    for exposure in (heated_plate.WEAK, heated_plate.STRONG):
        errors = heated_plate.errors(exposure)
        steady = exposure.steady
        measured = exposure.celsius[steady]
        rise = measured + ZERO_CELSIUS - heated_plate.AIR
        name = f"{exposure.irradiance / 1000:g} kW/m^2"
        computed = measured + float(errors[steady])
        limit = 0.05 * rise
        yield near(f"{name}, steady", computed, measured, unit="degC", tolerance=limit)
        rest = np.delete(errors, steady)
        yield near(f"{name}, rms otherwise", rms(rest), 0.0, unit="K")


GROUP = Group(
    "Measurements of the literature", (_still_air, _wind, _ground, _moon, _heated_plate)
)
