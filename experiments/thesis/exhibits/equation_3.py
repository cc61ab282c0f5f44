"""Equation 3: irradiance of a source by shadow map and cosine, beside closed forms."""

from ..exhibit import Exhibit, Finding, Verdict
from ..radiation import light_table, measure_light


def _measure(_: bool) -> Finding:
    found = measure_light()
    checks = found["checks"]
    worst = max(checks, key=lambda check: abs(check["error"]))
    met = all(check["passes"] for check in checks)
    reason = (
        f"Ball, plate, hollows and shadows catch what closed forms say: of "
        f"{len(checks)} the worst is {abs(worst['error']):.2%} off ({worst['what']}). "
        "The equation as printed has no 1 / R² and no bound at 0 where a surface is "
        "turned away; with a source's radiant intensity and both it holds."
    )
    return Finding(
        Verdict.DIFFERENT if met else Verdict.CONTRADICTED,
        reason,
        parts=(light_table(found),),
        numbers=found,
    )


EXHIBIT = Exhibit(
    name="equation-3",
    title="irradiance of a source with shadows",
    place="5.1, equation 3",
    claims=("C04",),
    measure=_measure,
)
