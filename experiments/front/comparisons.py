"""Choices of a front and rivals at the same error, timed alternately in one process."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import jax
import jax.numpy as jnp

from calibrate.study.case import Case, build_case, loop_size, plan_case
from calibrate.study.front import Measure, Point, fastest_within, front
from calibrate.study.times import compiled_loop
from calibrate.study.wording import ratio_text
from jaxthermo.arrays import precision
from jaxthermo.reduction.reduced_model import ReducedModel, load_reduced
from jaxthermo.report.numbers import significant
from jaxthermo.timing import Spans, Spread, interleaved, ratio_of, timed_call

from .rivals import TWELVE_STEPS, Rivals


Call = Callable[[], Any]
"""A run that is ready to be timed."""

_MAX_POINTS = 10
"""Largest number of points of the front that are compared at their own error."""

_SHORT_S = 0.5
"""Time of all repeats of short runs [s]."""
_MAX_REPEATS = 51
"""Largest number of repeats of a run."""


@dataclass(frozen=True)
class _Pair:
    """A choice and a rival within the same tolerance."""

    tolerance: float
    """Largest error of both [%]."""
    choice: Point
    rival: Point


class _PlainPoint(TypedDict):
    """A choice or a rival in `result.json`."""

    name: str
    choice: dict[str, str]
    errors: dict[Measure, float]


class PlainComparison(TypedDict):
    """A comparison in `result.json`."""

    tolerance_percent: float
    choice: _PlainPoint
    rival: _PlainPoint
    load: str
    times_faster: dict[str, float]
    spans_s: dict[str, Spans]


@dataclass(frozen=True)
class Comparison:
    """A pair that was timed, under the load where the ratio is smallest."""

    pair: _Pair
    load: str
    choice_time: Spread
    """Run time of the choice [s]."""
    rival_time: Spread
    """Run time of the rival [s]."""
    ratio: Spread
    """Time of the rival over that of the choice [-]."""
    spans: dict[str, Spans]
    """All times by load, of "choice" and "rival" [s]."""

    def sentence(self) -> str:
        """The ratio in words, without the processor's name."""
        return (
            f"up to {significant(self.pair.tolerance)} %: {self.pair.choice.name} is "
            f"{ratio_text(self.ratio)} times as fast as {self.pair.rival.name}"
        )

    def as_dict(self) -> PlainComparison:
        """Plain types for `result.json`."""
        return {
            "tolerance_percent": self.pair.tolerance,
            "choice": _plain(self.pair.choice),
            "rival": _plain(self.pair.rival),
            "load": self.load,
            "times_faster": self.ratio._asdict(),
            "spans_s": self.spans,
        }


def _plain(point: Point) -> _PlainPoint:
    return {"name": point.name, "choice": point.choice, "errors": point.errors}


def pairs(
    points: Sequence[Point],
    rivals: Sequence[Point],
    tolerances: Sequence[float],
    models: Sequence[Point] = (),
) -> list[_Pair]:
    """Choices and rivals to time: at each tolerance, and at each error of the front.

    Where RKL2 of 12 steps on voxels 250 high was run, the fastest choice and the
    fastest reduced model within its error are timed too. Reduced models are timed at
    each tolerance.
    """
    found_pairs: list[_Pair] = []

    def add(error: float, choices: Sequence[Point], opponents: Sequence[Point]) -> None:
        """Add the fastest choice and the fastest rival within an error [%]."""
        choice = fastest_within(choices, error)
        rival = fastest_within(opponents, error)
        if choice is not None and rival is not None:
            found_pairs.append(_Pair(error, choice=choice, rival=rival))

    by_kind: dict[str, list[Point]] = {}
    for rival in rivals:
        by_kind.setdefault(rival.kind, []).append(rival)
    twelve_steps = by_kind.pop(TWELVE_STEPS.name, [])
    for tolerance in tolerances:
        for of_kind in by_kind.values():
            add(tolerance, choices=points, opponents=of_kind)
    for rival in twelve_steps:
        for candidates in (points, models):
            add(rival.errors["rms_percent"], choices=candidates, opponents=[rival])
    for tolerance in tolerances:
        add(tolerance, choices=models, opponents=rivals)
    best = front(points)
    # Of a long front every second choice, or fewer.
    step = -(-len(best) // _MAX_POINTS) or 1
    for choice in best[::step]:
        add(choice.errors["rms_percent"], choices=[choice], opponents=rivals)
    return found_pairs


def time_pairs(
    pairs: Sequence[_Pair],
    loops: Callable[[Point], Iterator[tuple[str, Call]]],
    rivals: Rivals,
    repeats: int,
    log: Callable[[str], None],
) -> list[Comparison]:
    """Time choices and rivals alternately, under loads whose programs differ.

    Args:
        pairs: of choices and rivals that were measured by `rivals`.
        loops: of a choice or reduced model, each with the load that it is run under.
        rivals: which run the rivals.
        repeats: of each.
        log: called before each pair.

    Returns:
        A comparison for each pair, in their order.
    """
    comparisons: dict[int, Comparison] = {}
    # A choice is compiled once for all its rivals, and voxels are shared.
    names = {
        n: (str(pair.choice.set), pair.choice.name) for n, pair in enumerate(pairs)
    }
    for name in sorted(set(names.values())):
        numbers = [n for n in names if names[n] == name]
        spans: dict[int, dict[str, Spans]] = {n: {} for n in numbers}
        for load, loop in loops(pairs[numbers[0]].choice):
            for n in numbers:
                rival = pairs[n].rival
                log(f"timing {pairs[n].choice.name} and {rival.name}, {load}")
                calls: dict[str, Call] = {
                    "choice": loop,
                    "rival": rivals.run(rival, load).call,
                }
                count = _enough(calls.values(), repeats)
                spans[n][load] = interleaved(calls, count, there_and_back=True)
        comparisons |= {n: _comparison(pairs[n], spans[n]) for n in numbers}
    return [comparisons[n] for n in range(len(pairs))]


def _enough(calls: Collection[Call], repeats: int) -> int:
    """Number of repeats: more for short runs, which a pause of the system disturbs."""
    for call in calls:
        timed_call(call)
    seconds = sum(timed_call(call)[1] for call in calls)
    return max(repeats, min(_MAX_REPEATS, int(_SHORT_S / seconds)))


def choice_loops(cases: Mapping[str, Case]) -> Iterator[tuple[str, Call]]:
    """Compiled loops of a choice, one for loads that differ in numbers only."""
    timed: set[tuple[int, ...]] = set()
    for load, case in cases.items():
        plan = plan_case(case.config, build_case(case.config).scene)
        size = loop_size(plan)
        if size in timed:
            continue
        if size is not None:
            timed.add(size)
        yield load, compiled_loop(plan).run


def model_loops(folder: Path, models: Mapping[str, str]) -> Iterator[tuple[str, Call]]:
    """Runs of the reduced models of each load, from their files."""
    for load, name in models.items():
        yield load, model_loop(load_reduced(folder / name))


def model_loop(model: ReducedModel) -> Call:
    """Compiled run of a reduced model for the loads that it was made of."""
    with precision(model.dtype):
        function = jax.jit(model.as_function())
        amplitudes = jnp.asarray(model.amplitudes, model.dtype)

    def run() -> Any:
        with precision(model.dtype):
            return function(amplitudes)

    return run


def _comparison(pair: _Pair, spans: dict[str, Spans]) -> Comparison:
    ratios = {
        load: ratio_of(load_spans["rival"], load_spans["choice"])
        for load, load_spans in spans.items()
    }
    load = min(ratios, key=lambda load_name: ratios[load_name].median)
    return Comparison(
        pair=pair,
        load=load,
        choice_time=Spread.of(spans[load]["choice"]),
        rival_time=Spread.of(spans[load]["rival"]),
        ratio=ratios[load],
        spans=spans,
    )
