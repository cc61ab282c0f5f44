"""Section 5.1: the flux of 31.15 W/m² over 10 m, beside a closed view factor."""

from ..exhibit import Exhibit, Finding, Row, Verdict
from ..radiation import measure_thesis_flux


def _measure(_: bool) -> Finding:
    found = measure_thesis_flux()
    ours = found["two_squares_of_1_m_W_m2"]
    thesis = found["thesis_W_m2"]
    reason = (
        f"Two black squares of 1 m², 400 K and 300 K, exchange {ours:.4g} W/m² over 10 "
        f"m. The thesis has {found['thesis_over_right']:.2f} times as much, which is "
        f"π² ({found['pi_squared']:.2f}): E π / R² stands where Lambert's law has "
        "E A / (π R²). Its conclusion at 10 m is the stronger for it."
    )
    edge = found["edge_of_squares_that_give_it_m"]
    rows = (
        Row("flux over 10 m at a difference of 100 K [W/m²]", thesis, ours),
        Row("E π / R², the slip [W/m²]", thesis, found["E_pi_over_R2_W_m2"]),
        Row(
            "E A / (π R²) of a small emitter of 1 m² [W/m²]",
            None,
            found["small_emitter_E_over_pi_R2_W_m2"],
        ),
        Row("edge of two squares that exchange as much [m]", None, edge),
    )
    chosen = (
        ("temperatures", "400 K and 300 K: the difference is given, not the two"),
        ("area", "squares of 1 m²: the thesis names a distance but no size"),
    )
    return Finding(Verdict.CONTRADICTED, reason, rows, chosen=chosen, numbers=found)


EXHIBIT = Exhibit(
    name="section-5.1-flux",
    title="the flux of a body 100 K warmer",
    place="5.1",
    claims=("C02",),
    measure=_measure,
)
