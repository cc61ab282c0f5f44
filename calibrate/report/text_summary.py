"""A fit in words: how it ended, what it changed, and what its verdicts mean."""

from typing import Any

from .charts import Result, told


GROUPS = {"train": "fitted to", "held_out": "held out"}
"""What was fitted and what was only checked, in words."""

MEANING = {
    "fine": "the data tell it",
    "trade-off": "correlated by more than 0.95 with the others named: the data tell "
    "them together, hardly one by one",
    "at bound": "ended at an end of its range: widen the bounds, or leave it there",
    "not pinned": "its standard error is wider than its bounds, or than a factor of e",
    "flat": "the data tell only a combination of it with the others named: fix one of "
    "them, give a prior, or add a case",
    "not judged": "one of too many values to be judged one by one",
    "dead": "nothing that is compared changes with it: leave it out, or add a case "
    "in which it acts",
}

FAR = 2.0
"""Times the noise, beyond which its error bars tell too little."""

ENDED = {
    "converged": "ended by itself: no further step is worth it",
    "step limit": "was cut off at its step limit: it may not be the best yet",
    "interrupted": "was stopped: the same command goes on from there",
}


def is_frames(result: Result) -> bool:
    """Whether pixels were fitted, and errors are counted in their noise."""
    return "frames" in result["reference"]


def error_title(result: Result) -> str:
    """Of the axis of an error."""
    return "RMS error [% of the noise]" if is_frames(result) else "RMS error [%]"


def error_words(percent: float, result: Result) -> str:
    """An error with what it is counted in."""
    if is_frames(result):
        return f"{number(percent / 100)} times the noise"
    return f"{number(percent)} %"


def name_of(name: str, row: dict[str, Any]) -> str:
    """Of a value; of a field, what its row says of its many values."""
    count = row.get("count", 1)
    if count == 1:
        return name
    span = f"{row['min']:.3g} to {row['max']:.3g}"
    return f"{name}: median of {count:,}, {span}"


def definition(result: Result) -> str:
    """What an error is."""
    if is_frames(result):
        return (
            "The error is the root mean square over all pixels that count, of model "
            "less data, over the noise of a pixel: 100 % is as good as the noise "
            "allows. A case's error is its largest over the saved times. "
            "Default: with the values at the start."
        )
    return (
        "The error is the area-weighted root mean square over the surface of the "
        "difference from the reference, over the reference's range (max - min) at that "
        "time, or over 5 % of the run's largest range where that is more. A case's "
        "error is its largest over the saved times. Default: with the values at the "
        "start."
    )


def about_bars(result: Result) -> str:
    """What the error bars of values are by."""
    text = (
        "Bars are one standard error to each side; on a logarithmic axis a factor "
        "exp(standard error / value). What the data do not tell has none. "
    )
    return text + about_errors(result)


def about_errors(result: Result) -> str:
    """What standard errors follow from."""
    if not is_frames(result):
        return (
            "Standard errors are by what the fit left over, as there is no noise: they "
            "say which values the data tell best, not how near they are to a truth."
        )
    over = result["error_percent"]["train"]["fitted"] / 100
    text = "Standard errors follow from the noise of a pixel."
    if over > FAR:
        text += (
            f" But model and data differ by {over:.3g} times the noise: the model is "
            "wrong by more than its values can mend, and they are too small."
        )
    return text


def summary(result: Result) -> list[str]:
    """The fit in sentences."""
    return [_what(result), *_errors(result), _end(result), *_speed(result)]


def _what(result: Result) -> str:
    cases = {group: list(both["fitted"]) for group, both in result["errors"].items()}
    data = "frames" if is_frames(result) else "reference runs"
    values = sum(row.get("count", 1) for row in result["parameters"].values())
    text = f"{plural(values, 'value')} fitted to {data} of "
    text += f"{plural(len(cases['train']), 'case')} ({', '.join(cases['train'])}); "
    held = cases.get("held_out")
    if not held:
        return text + "nothing was held out, so nothing tells how far the fit carries."
    many = plural(len(held), "case")
    return f"{text}checked on {many} held out ({', '.join(held)})."


def _errors(result: Result) -> list[str]:
    return [
        f"Error, {GROUPS[group]}: {error_words(both['default'], result)} before, "
        f"{error_words(both['fitted'], result)} after ({change(**both)})."
        for group, both in result["error_percent"].items()
    ]


def change(default: float, fitted: float) -> str:
    """How many times less an error is."""
    if not (default > 0 and fitted > 0):
        return "no ratio"
    if fitted <= default:
        return f"{default / fitted:.2f} times less"
    return f"{fitted / default:.2f} times MORE"


def _end(result: Result) -> str:
    spent, loss = result["run_time_s"], result["loss"]
    text = f"The fit {ENDED.get(result['ended'], result['ended'])}; "
    text += f"{plural(len(result['steps']), 'step')} took {spent['fit']:.3g} s, after "
    text += f"{spent['compile']:.3g} s of compiling; the loss went from "
    text += f"{loss['initial']:.4g} to {loss['final']:.4g}."
    return text


def _speed(result: Result) -> list[str]:
    speed: dict[str, Any] = result["speedup"]
    if not told(speed.get("times_faster")):
        return []
    text = f"It runs {speed['times_faster']:.3g} times as fast as the full volume "
    text += f"({speed['min']:.3g} to {speed['max']:.3g} in "
    text += f"{plural(len(speed['run_time_s']['fitted']), 'warm run')}), "
    text += f"with {speed['nodes']['fitted']:,} nodes for "
    text += f"{speed['nodes']['full_volume']:,} and {speed['steps']['fitted']:,} steps "
    text += f"for {speed['steps']['full_volume']:,}."
    return [text]


def number(value: float) -> str:
    """With three digits, or all that stand before the point."""
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:,.0f}"


def plural(count: int, noun: str) -> str:
    """A count of things."""
    return f"{count:,} {noun}{'s' * (count != 1)}"
