"""A fit in sentences and tables, for the terminal and for the page."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from jaxthermo.host_memory import readable_bytes
from jaxthermo.report.numbers import (
    count,
    is_finite,
    padded,
    significant,
    with_range,
)
from jaxthermo.report.table import Cell, Table

from ..analysis.verdict import TimeErrors, TruthTime, time_errors, truth_times
from ..config.fit_record import (
    FitRecord,
    ParameterRow,
    TruthRecord,
    each_group,
    number_of,
)


GROUPS = {"train": "fitted to", "held_out": "held out"}
"""Groups of cases in words."""

MEANING = {
    "fine": "the data determine it",
    "trade-off": "correlated by more than 0.95 with the others named: the data "
    "determine them together, hardly one by one",
    "misfit": "the data determine it, but the model and the data differ by more than "
    "the noise allows: it may be wrong by more than its standard error",
    "not converged": "the search ended half a standard error or more away from the "
    "minimum: give more steps or another start",
    "ambiguous": "a search from another start ended elsewhere with an error that is as "
    "small: narrow the bounds, give a prior, or add a case",
    "at bound": "ended at an end of its range: widen the bounds, or leave it there",
    "not pinned": "its standard error is wider than its bounds, or than a factor of e",
    "flat": "the data determine only a combination of it with the others named: fix "
    "one of them, give a prior, or add a case",
    "not judged": "one of too many values to be judged one by one",
    "dead": "it has no effect on what is compared: leave it out, or add a case in "
    "which it acts",
}

_AnyTime = TypeVar("_AnyTime", TimeErrors, TruthTime)
_IS_GOOD = {
    "fine": True,
    "misfit": False,
    "not converged": False,
    "ambiguous": False,
    "dead": False,
    "flat": False,
    "not pinned": False,
}
_MAX_NOISE_RATIO = 2.0
"""Error over the noise, beyond which errors that were not widened are too small."""
_BEFORE_AND_AFTER = (
    "Default, or before: with the scene's own values; fitted, or after: with those "
    "of the fit."
)
_DASH = "\N{EN DASH}"
_ENDED = {
    "converged": "converged",
    "step limit": "reached its step limit: it may not be the best yet",
    "stalled": "found no better values near by, though the gradient is not 0: give "
    "other starts",
    "at the limit of its steps": "is at the limit of its steps: stiffer values would "
    "take more than 100 times the time steps of the start; start nearer to them",
    "interrupted": "was interrupted: the same command continues from there",
}


def is_frames(result: FitRecord) -> bool:
    """True if pixels were fitted, whose errors are relative to their noise."""
    return "frames" in result["reference"]


def error_unit(result: FitRecord) -> str:
    """Unit of an error."""
    return "% of the noise" if is_frames(result) else "%"


def error_title(result: FitRecord) -> str:
    """Title of an error's axis."""
    return f"RMS error [{error_unit(result)}]"


def _error_words(percent: float, result: FitRecord) -> str:
    if is_frames(result):
        return f"{padded(percent / 100)} times the noise"
    return f"{padded(percent)} %"


def definition(result: FitRecord) -> str:
    """Definition of the error."""
    if is_frames(result):
        return (
            "The error is the root mean square over all compared pixels of model minus "
            "data, over the noise of a pixel: 100 % is as good as the noise allows. A "
            "case's error is its largest over the saved times. " + _BEFORE_AND_AFTER
        )
    return (
        "The error is the area-weighted root mean square over the surface of the "
        "difference from the reference, over the reference's range (max - min) at that "
        "time, or over 5 % of the run's largest range where that is more. A case's "
        "error is its largest over the saved times. " + _BEFORE_AND_AFTER
    )


def about_standard_errors(result: FitRecord) -> str:
    """Origin of the standard errors, and a warning where they are too small."""
    if not is_frames(result):
        return (
            "Standard errors follow from the residuals that the fit left, as there is "
            "no noise: they rank the values by how well the data determine them, and "
            "do not bound their distance from a truth."
        )
    text = "Standard errors follow from the noise of a pixel."
    # Records of earlier versions have neither this nor a widening.
    if result.get("by_clusters", False):
        text = (
            "Standard errors follow from the residuals, alike within squares of the "
            "image and independent between them."
        )
    widening = result.get("widening")
    ratio = result["error_percent"]["train"]["fitted"] / 100
    if widening is None and ratio > _MAX_NOISE_RATIO:
        text += (
            f" But model and data differ by {ratio:.3g} times the noise: the model is "
            "wrong by more than its values can correct, and these errors are too small."
        )
    if widening is not None and widening > 1:
        text += (
            " They are as large as residuals that differ from the model by "
            f"{widening:.3g} times what noise leaves in their means, see below."
        )
    declared = result.get("shared_errors", {})
    shared = [f"{100 * sd:.3g} % of the {name}" for name, sd in declared.items()]
    if shared:
        text += (
            f" They include errors that all pixels share, of {' and '.join(shared)}."
        )
    missing = [name for name in ("gain", "emissivity") if name not in declared]
    if missing:
        options = " and ".join(f"`{name}_uncertainty`" for name in missing)
        text += (
            f" An error of the {' or the '.join(missing)} that all pixels share is in "
            f"no residual, and not in them: {options} of the reference declare it."
        )
    return text


def summary(result: FitRecord) -> list[str]:
    """Sentences on data, errors, course of the fit and speed; the verdict is first."""
    errors = [
        f"Largest error of the cases {GROUPS[group]}: "
        f"{_error_words(errors['default'], result)} before, "
        f"{_error_words(errors['fitted'], result)} after ({_change(**errors)})."
        for group, errors in each_group(result["error_percent"])
    ]
    cost = _truth_cost(result)
    course = _course(result)
    speed = _speed(result)
    verdict = f"Verdict: {result['verdict']['words']}."
    return [verdict, _data(result), *errors, course, *speed, *cost]


def time_table(result: FitRecord, title: str = "") -> Table:
    """Errors at every saved time of every case, default and fitted."""
    unit = error_unit(result)
    columns = ["case", "role", "time [s]", f"default [{unit}]", f"fitted [{unit}]"]
    rows = _time_rows(time_errors(result["errors"]), lambda row: [])
    return Table(columns, rows, title=title, left=(0, 1))


def _time_rows(
    times: Iterable[_AnyTime], further: Callable[[_AnyTime], Sequence[str | Cell]]
) -> list[list[str | Cell]]:
    """Case, time and both errors by row; `further` gives the cells that follow."""
    rows = []
    last_case = None
    for row in times:
        # A case is named once.
        case = (row.case, GROUPS[row.group])
        named = ("", "") if case == last_case else case
        last_case = case
        fitted = padded(row.fitted)
        words = f"{fitted}, more" if row.is_worse else fitted
        cell = Cell(words, not row.is_worse, is_number=True)
        numbers = [f"{row.time:g}", padded(row.default), cell]
        rows.append([*named, *numbers, *further(row)])
    return rows


def truth_table(result: FitRecord, title: str = "") -> Table | None:
    """Errors against finer voxels at every saved time; None if there are none."""
    truth = result.get("truth")
    if truth is None:
        return None
    columns = ["case", "role", "time [s]", "default [K]", "fitted [K]"]
    columns += ["default [%]", "fitted [%]", "own error [K]"]
    rows = _time_rows(truth_times(truth), _truth_cells)
    return Table(columns, rows, title=title, left=(0, 1))


def _truth_cells(row: TruthTime) -> list[str | Cell]:
    reference = padded(row.reference)
    mark = f"bound {reference}" if row.is_bound else reference
    percents = [_percent(row.default_percent), _percent(row.fitted_percent)]
    return [*percents, Cell(mark, is_number=True)]


def _percent(value: float | None) -> str:
    return _DASH if value is None else padded(value)


def truth_definition(truth: TruthRecord) -> str:
    """Definition of the errors against finer voxels."""
    structure = truth["structure"].replace("_", " ")
    return (
        "Root mean square over points spread evenly over the mesh of the difference in "
        f"surface temperature from a run ({structure}) in voxels "
        f"{truth['refinement']:.3g} times as fine, in K and in percent of that run's "
        "range (0.5 to 99.5 %) at that time. Own error: of that run, from two coarser "
        "ones by Richardson extrapolation; a bound is the larger difference between "
        "these runs, where the observed order is not within 0.5 to 3. Red: larger by "
        "more than twice the own error."
    )


def _truth_cost(result: FitRecord) -> list[str]:
    """Cost of the reference runs of finer voxels, and remarks on them."""
    truth = result.get("truth")
    if truth is None:
        return []
    runs = truth["cost"]
    cached = sum(run["cached"] for run in runs)
    seconds = sum(run["run_time_s"] for run in runs)
    largest = max(runs, key=lambda run: run["memory_bytes"])
    new_seconds = sum(run["run_time_s"] for run in runs if not run["cached"])
    groups = (cases for _, cases in each_group(truth["cases"]))
    cases = [case for group in groups for case in group.values()]
    remarks = [r for case in cases for r in case["fitted"]["remarks"]]
    for run in runs:
        # The two coarser runs only tell how far this one is off.
        if run["refinement"] == truth["refinement"]:
            remarks += [f"the reference of {run['case']}: {w}" for w in run["warnings"]]
    return [
        f"The references of finer voxels took {count(len(runs), 'run')}, "
        f"{new_seconds:.3g} s now and {seconds - new_seconds:.3g} s before this fit "
        f"({cached} from the cache); the largest has {largest['nodes']:,} nodes and "
        f"takes about {readable_bytes(largest['memory_bytes'])}.",
        *(f"Note: {remark}." for remark in dict.fromkeys(remarks)),
    ]


def _data(result: FitRecord) -> str:
    cases = {
        group: list(pair["fitted"]) for group, pair in each_group(result["errors"])
    }
    data = "frames" if is_frames(result) else "reference runs"
    values = sum(row.get("count", 1) for row in result["parameters"].values())
    train = cases["train"]
    held_out = cases.get("held_out")
    text = f"{count(values, 'value')} fitted to {data} of "
    text += f"{count(len(train), 'case')} ({', '.join(train)}); "
    if not held_out:
        return text + "nothing was held out, so the fit is not validated elsewhere."
    many = count(len(held_out), "case")
    return f"{text}validated on {many} held out ({', '.join(held_out)})."


def _change(default: float, fitted: float) -> str:
    # Data of the same model may be met exactly.
    if not (default > 0 and fitted > 0):
        return "no ratio"
    if fitted <= default:
        return f"{default / fitted:.2f} times less"
    return f"{fitted / default:.2f} times MORE"


def _course(result: FitRecord) -> str:
    seconds = result["run_time_s"]
    loss = result["loss"]
    # In runs, which is a measure that does not depend on the machine.
    runs = seconds["fit"] / max(seconds["one_run"], 1e-9)
    return (
        f"The fit {_ENDED.get(result['ended'], result['ended'])}; "
        f"{count(len(result['steps']), 'step')} took {seconds['fit']:.3g} s, as long "
        f"as {runs:.3g} runs of all cases, after {seconds['compile']:.3g} s of "
        "compiling; "
        f"the loss went from {loss['initial']:.4g} to {loss['final']:.4g}."
    )


def _speed(result: FitRecord) -> list[str]:
    speed = result["speedup"]
    if not is_finite(speed["times_faster"]):
        return []
    runs = count(len(speed["run_time_s"]["fitted"]), "warm run")
    median, low, high = (
        number_of(speed[key]) for key in ("times_faster", "min", "max")
    )
    before = significant(number_of(speed["default"]["times_faster"]))
    nodes = speed["nodes"]
    steps = speed["steps"]
    return [
        f"A run is {with_range(median, low=low, high=high)} times as fast as the full "
        f"volume's (in {runs}; {before} before the fit), "
        f"with {nodes['fitted']:,} nodes for {nodes['full_volume']:,} "
        f"and {steps['fitted']:,} steps for {steps['full_volume']:,}."
    ]


def parameter_table(
    parameters: Mapping[str, ParameterRow], title: str, is_fitted: bool = True
) -> Table:
    """Values, standard errors and verdicts."""
    columns = ["parameter", "start", "standard error", "verdict"]
    if is_fitted:
        columns[2:2] = ["fitted", "ratio"]
    rows = []
    for name, row in parameters.items():
        error = row["standard_error"]
        start = row["initial"]
        unit = row["unit"]
        start_words = f"{start:.4g} {unit}".strip()
        cells: list[str | Cell] = [_parameter_name(name, row), start_words]
        if is_fitted:
            ratio = padded(row["value"] / start) if start else _DASH
            cells += [f"{_digits(row['value'], 4)} {unit}".strip(), ratio]
        # More digits of an error say nothing.
        two_digits = _digits(number_of(error), 2) if is_finite(error) else _DASH
        related = f" with {', '.join(row['with'])}" if row["with"] else ""
        cells += [two_digits, marked(row["verdict"], related)]
        rows.append(cells)
    return Table(columns, rows, title=title, left=(0, len(columns) - 1))


def _digits(value: float, number: int) -> str:
    # With zeros at the end, which say how well a fitted value is known.
    return f"{value:#.{number}g}".removesuffix(".")


def _parameter_name(name: str, row: ParameterRow) -> str:
    # A field of thousands of values has one row.
    number = row.get("count", 1)
    if number == 1:
        return name
    low = row.get("min", math.nan)
    high = row.get("max", math.nan)
    return f"{name}: median of {number:,}, {low:.3g} to {high:.3g}"


def marked(verdict: str, remark: str = "") -> Cell:
    """Verdict in green or red."""
    return Cell(verdict + remark, _IS_GOOD.get(verdict))


def experiment_table(result: FitRecord, limit: int | None = None) -> Table:
    """Experiments that might be added, the most informative first."""
    entries = result["advice"][:limit]
    rows = [[e["what"], f"{e['gain_nats']:.2f}"] for e in entries]
    return Table(["further experiment", "information gain [nats]"], rows)
