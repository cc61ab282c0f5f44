"""Figure 6.5: mean speed behind a cylinder as a convergent function f(x) = v."""

from jaxthermo.flow.wake_fit import FAMILIES

from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..wake import fit_chart, fit_table
from ..wake_flows import chosen, four_speeds, narrow_and_wide


# Deviation of the best function, in undisturbed speeds, up to which it converges so.
_GOOD = 0.03


def _measure(quick: bool) -> Finding:
    narrow, wide = narrow_and_wide(quick)
    flows = (narrow, *four_speeds(quick))
    worst = {
        family.name: max(flow.row["fits"][family.name]["rms"] for flow in flows)
        for family in FAMILIES
    }
    best = max(min(fit["rms"] for fit in f.row["fits"].values()) for f in flows)
    verdict = Verdict.DIFFERENT if best <= _GOOD else Verdict.CONTRADICTED
    listed = ", ".join(f"{name} {rms:.3f}" for name, rms in worst.items())
    reason = (
        "Behind the bubble of reversed flow a convergent function fits each of the "
        f"five wakes to {best:.3f} of the undisturbed speed, but not one family all: "
        f"largest deviations are {listed}. The thesis names no function and no "
        "number. Nearer to the body the speed first falls below zero, which a "
        "function that rises from low to high does not."
    )
    rows = tuple(
        Row(f"largest rms, {name}", None, rms, "of the undisturbed speed")
        for name, rms in worst.items()
    )
    caption = (
        "The wide pipe at speed 1.0. Exponential: 1 - A exp(-x/l); power: "
        "1 - A (1 + (x/l)²)^(-p/2); confined: times exp(-x/c); remainder: "
        "1 - (A - r)(1 + (x/l)²)^(-4) - r."
    )
    parts = (
        Plot("wake_fits", fit_chart(wide.row, wide.tail), caption),
        fit_table([flow.row for flow in flows]),
    )
    numbers = {"rms": worst, "best_of_each": best}
    return Finding(verdict, reason, rows, {}, chosen(quick), parts, numbers)


EXHIBIT = Exhibit(
    name="figure-6.5",
    title="the wake as a convergent function of the distance",
    place="6.2, figure 6.5",
    claims=("C24",),
    measure=_measure,
)
