"""Table 5.1: heating rates of a cube of twelve materials; the flux behind them."""

from dataclasses import dataclass

import jaxthermo as jt
from jaxthermo.geometry.shapes import box
from jaxthermo.material.table import material_rows, thesis_material

from ..exhibit import Exhibit, Finding, Row, Verdict


# Heat flux onto one face [W/m^2].
_FLUX = 31.15
# Rates as printed [K/s].
_RATES = {
    "platinum": 1.08e-5,
    "gold": 1.28e-5,
    "mercury": 1.64e-5,
    "lead": 2.15e-5,
    "silver": 1.27e-5,
    "copper": 9.01e-6,
    "iron": 8.91e-6,
    "diamond": 1.75e-5,
    "aluminium": 1.29e-5,
    "water": 7.44e-6,
    "ethanol": 1.62e-5,
    "gasoline": 1.92e-5,
}
# Steps of one second.
_SECONDS, _QUICK_SECONDS = 1000, 10


@dataclass(frozen=True)
class _Rate:
    """Rate of one material [K/s]: printed, simulated, and with newer properties."""

    name: str
    printed: float
    simulated: float
    reference: float


def _rates(seconds: int) -> list[_Rate]:
    cube = jt.FullVolume(jt.voxelize(box((1.0, 1.0, 1.0)), 1.0))
    flux = jt.HeatFlux(_FLUX, on=jt.Side((0.0, 0.0, 1.0)))
    found = []
    for row in material_rows():
        if row.name not in _RATES:
            continue
        material = thesis_material(row.name)
        body = jt.Body(cube, material, temperature=300.0)
        scene = jt.Scene((body,), (flux,), dtype="float64")
        run = jt.simulate(scene, float(seconds), solver=jt.ForwardEuler(dt=1.0))
        # In heat: a rise of 1e-5 K is rounded off a temperature of 300 K.
        stored = float(run.energy.stored_J[0])
        simulated = stored / float(material.volumetric_heat_capacity) / seconds
        reference = _FLUX / (row.density * row.specific_heat)
        found.append(_Rate(row.name, _RATES[row.name], simulated, reference))
    return found


def _measure(quick: bool) -> Finding:
    rates = _rates(_QUICK_SECONDS if quick else _SECONDS)
    same = [f"{r.simulated:.2e}" == f"{r.printed:.2e}" for r in rates]
    far = max(rates, key=lambda r: abs(r.reference / r.simulated - 1))
    difference = far.reference / far.simulated - 1
    verdict = Verdict.REPRODUCED if all(same) else Verdict.CONTRADICTED
    reason = (
        f"{sum(same)} of {len(same)} rates agree to the three digits printed: they are "
        "q A / (ρ c V) of a cube of 1 m³ with one face heated and no losses. With "
        "newer material properties the largest difference is "
        f"{difference:+.1%} ({far.name})."
    )
    rows = tuple(
        Row(
            f"{r.name} [K/s]",
            f"{r.printed:.2e}",
            f"{r.simulated:.2e}",
            f"{r.reference:.2e} with reference density and heat capacity",
        )
        for r in rates
    )
    chosen = (
        ("body", "a single voxel of 1 m³, 31.15 W/m² onto one face, no losses"),
        ("conductivity", "of our table; the thesis has none, and one voxel needs none"),
    )
    numbers = {
        r.name: {
            "thesis_K_s": r.printed,
            "ours_K_s": r.simulated,
            "reference_K_s": r.reference,
        }
        for r in rates
    }
    return Finding(verdict, reason, rows, chosen=chosen, numbers=numbers)


EXHIBIT = Exhibit(
    name="table-5.1",
    title="heating rates of a cube by 31.15 W/m²",
    place="5.1, table 5.1",
    claims=("C01",),
    measure=_measure,
)
