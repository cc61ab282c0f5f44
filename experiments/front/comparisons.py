"""Choices of a front and rivals at the same error, timed in turn in one process."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from calibrate.runs.case import Case
from calibrate.runs.scenes import build_case, loop_size, plan_case
from calibrate.runs.times import compiled_loop
from jaxthermo.arrays import precision
from jaxthermo.reduction.reduced_model import ReducedModel, load_reduced
from jaxthermo.report.numbers import significant

from ..harness.timing import Spans, interleaved, timed_call
from .pareto import Point, Spread, fastest_within, front, ratio_of, spread_of
from .rivals import TWELVE_STEPS, Rivals
from .wording import ratio_text


Call = Callable[[], Any]
"""A run that is ready to be timed."""

MAX_POINTS = 10
"""Points of the front that are compared at their own error."""


_SHORT_S, _MAX_REPEATS = 0.5, 51
"""Time that is spent on repeats of short runs [s], and their largest number."""


@dataclass(frozen=True)
class Pair:
    """A choice and a rival whose errors are within the same one."""

    tolerance: float
    """[%]"""
    choice: Point
    rival: Point


@dataclass(frozen=True)
class Comparison:
    """A pair that was timed, under the load where the ratio is smallest."""

    pair: Pair
    load: str
    choice_time: Spread
    """[s]"""
    rival_time: Spread
    """[s]"""
    ratio: Spread
    """Time of the rival over that of the choice [-]."""
    spans: dict[str, Spans]
    """All times by load, of "choice" and "rival" [s]."""

    def sentence(self) -> str:
        """The ratio in words, with the processor's name apart."""
        return (
            f"up to {significant(self.pair.tolerance)} %: {self.pair.choice.name} is "
            f"{ratio_text(self.ratio)} times as fast as {self.pair.rival.name}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain types for `result.json`."""
        point = lambda p: {"name": p.name, "choice": p.choice, "errors": p.errors}
        return {
            "tolerance_percent": self.pair.tolerance,
            "choice": point(self.pair.choice),
            "rival": point(self.pair.rival),
            "load": self.load,
            "times_faster": vars(self.ratio),
            "spans_s": self.spans,
        }


def pairs(
    points: Sequence[Point],
    rivals: Sequence[Point],
    tolerances: Sequence[float],
    models: Sequence[Point] = (),
) -> list[Pair]:
    """Choices and rivals to time: at each tolerance, and at each error of the front.

    Where RKL2 of 12 steps on 250-high voxels was run, also the fastest choice and the
    fastest reduced model that are not farther from the truth than this. Reduced models
    are timed at each tolerance.
    """
    kinds = list(dict.fromkeys(rival.kind for rival in rivals))
    found = []
    for tolerance in tolerances:
        choice = fastest_within(points, tolerance)
        if choice is None:
            continue
        for kind in kinds:
            own = [rival for rival in rivals if rival.kind == kind]
            rival = fastest_within(own, tolerance)
            if rival is not None and kind != TWELVE_STEPS.name:
                found.append(Pair(tolerance, choice, rival))
    for rival in rivals:
        if rival.kind != TWELVE_STEPS.name:
            continue
        error = rival.errors["rms_percent"]
        nearer = (fastest_within(each, error) for each in (points, models))
        found += [Pair(error, choice, rival) for choice in nearer if choice is not None]
    for tolerance in tolerances:
        model, rival = (fastest_within(each, tolerance) for each in (models, rivals))
        if model is not None and rival is not None:
            found.append(Pair(tolerance, model, rival))
    for choice in _thinned(front(points)):
        error = choice.errors["rms_percent"]
        rival = fastest_within(rivals, error)
        if rival is not None:
            found.append(Pair(error, choice, rival))
    return found


def _thinned(points: Sequence[Point]) -> list[Point]:
    step = -(-len(points) // MAX_POINTS)
    return list(points[:: step or 1])


def time_pairs(
    pairs: Sequence[Pair],
    loops: Callable[[Point], Iterator[tuple[str, Call]]],
    rivals: Rivals,
    repeats: int,
    log: Callable[[str], None],
) -> list[Comparison]:
    """Time choices and rivals in turn, under loads that differ in more than numbers.

    Args:
        pairs: of choices and rivals that were measured by `rivals`.
        loops: of a choice or reduced model, each with the load that it is run under.
        rivals: which run the rivals.
        repeats: of each.
        log: told before each pair.

    Returns:
        A comparison for each pair, in their order.
    """
    found: dict[int, Comparison] = {}
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
                log(f"timing {pairs[n].choice.name} beside {rival.name}, {load}")
                setting = rivals.setting(rival.kind, rival.choice)
                calls: dict[str, Call] = {
                    "choice": loop,
                    "rival": rivals.run(setting, load).call,
                }
                count = _enough(calls.values(), repeats)
                spans[n][load] = interleaved(calls, count, there_and_back=True)
        found |= {n: _comparison(pairs[n], spans[n]) for n in numbers}
    return [found[n] for n in range(len(pairs))]


def _enough(calls: Collection[Call], repeats: int) -> int:
    """More repeats of runs so short that a pause of the system shows in them."""
    for call in calls:
        timed_call(call)
    whole = sum(timed_call(call)[1] for call in calls)
    return max(repeats, min(_MAX_REPEATS, int(_SHORT_S / whole)))


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


def _comparison(pair: Pair, spans: dict[str, Spans]) -> Comparison:
    ratios = {
        load: ratio_of(found["rival"], found["choice"]) for load, found in spans.items()
    }
    load = min(ratios, key=lambda each: ratios[each].median)
    own = spread_of(spans[load]["choice"])
    other = spread_of(spans[load]["rival"])
    return Comparison(
        pair=pair,
        load=load,
        choice_time=own,
        rival_time=other,
        ratio=ratios[load],
        spans=spans,
    )
