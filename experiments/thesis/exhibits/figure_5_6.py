"""Figure 5.6: the local Nusselt number around a cylinder."""

from ..convection_numbers import FAST, SLOW, local_chart, local_table, measure_local
from ..exhibit import Exhibit, Finding, Note, Plot, Verdict


def _measure(_: bool) -> Finding:
    found = measure_local()
    worst = max(abs(row["average_mismatch"]) for row in found)
    counts = {
        n: [row["Re"] for row in found if len(row["minima_deg"]) == n]
        for n in (0, 1, 2)
    }
    first = {n: f"{min(each):g}" for n, each in counts.items() if n and each}
    reason = (
        "The local number is an average times a shape of 16 cosines, so that the "
        f"average around the cylinder is the chosen one, to {worst:.0e} of itself. "
        f"It has one minimum from Re {first[1]} and two from Re {first[2]}. Its points "
        "above Re 7e4 are written down from memory of the published figure, ±15 %: "
        "they prove the shape, not the level."
    )
    parts = (
        Plot(
            "local-fast",
            local_chart(FAST, "Fast flow, as in figure 5.6 (points: recalled, ±15 %)"),
            "Local Nusselt number over the angle from the upstream line.",
        ),
        Plot(
            "local-slow",
            local_chart(SLOW, "Slow flow, Pr 0.71"),
            "Points: a steady flow computed with another method.",
        ),
        local_table(found),
        Note("Angles are counted from the upstream stagnation line."),
    )
    return Finding(Verdict.DIFFERENT, reason, parts=parts)


EXHIBIT = Exhibit(
    name="figure-5.6",
    title="local Nusselt number around a cylinder",
    place="5.4, figure 5.6",
    claims=("C20",),
    measure=_measure,
)
