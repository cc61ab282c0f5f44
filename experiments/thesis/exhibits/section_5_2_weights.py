"""Section 5.2: tuned conduction weights, on training loads and on one held out."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from calibrate.make_cards import read_recipes
from calibrate.report.card_list import card_table
from calibrate.study.case import changed_config
from jaxthermo.config.card_file import load_card
from jaxthermo.config.shipped_cards import SCHEME, shipped_cards
from jaxthermo.report.numbers import significant
from jaxthermo.report.table import Cell, Table
from jaxthermo.structures.weights import FitCard

from ...harness.present import from_to
from ..bodies import CONFIGS, buddha
from ..exhibit import Exhibit, Finding, Note, Part, Picture, Plot, Row, Verdict
from ..tuned import (
    BY_HAND,
    FITTED,
    HELD_OUT,
    LEVELS,
    NESTED,
    SHELL,
    TRAIN,
    UNTUNED,
    Tuned,
    tuned,
    tuning_chart,
)


_HEIGHT, _QUICK_HEIGHT = 125, 60
# Largest error of a surface that is near the full volume's [% of its range].
_NEAR = 2.0
_KINDS = (UNTUNED, BY_HAND, FITTED)
_GROUPS = {TRAIN: "training loads", HELD_OUT: "load held out"}


def _measure(quick: bool) -> Finding:
    height = _QUICK_HEIGHT if quick else _HEIGHT
    found = [tuned(name, height) for name in ((SHELL,) if quick else _NAMES)]
    verdict, outcome = _verdict(found)
    sentences = [_sentence(each) for each in found]
    cards = {name: load_card(SCHEME + name) for name in shipped_cards()}
    reason = " ".join([outcome, *sentences, _card_sentence(cards.values())])
    rows = tuple(
        Row(
            f"{each.name}, {words}, {kind} [% of the range]",
            "as real as possible" if kind == BY_HAND else None,
            each.worst(kind, group),
            _weight_words(each, kind),
        )
        for each in found
        for group, words in _GROUPS.items()
        for kind in _KINDS
    )
    chosen = (
        *buddha().stands_in,
        ("tuning", "the thesis has no weight, no load and no measure of what is real"),
        (
            "one weight",
            "a factor of all conductances in steps of an eighth of a decade: by hand",
        ),
        ("all weights", "those of configs/calibration, by least squares, capacity too"),
        (
            "loads",
            "sun from two sides of the file to train on, from a third one held out; "
            "stainless steel, 180 s",
        ),
        ("size", f"{height} voxels high; the reference is their full volume"),
    )
    parts: list[Part] = []
    for each in found:
        word = each.name.replace(" ", "-")
        parts += [
            Plot(
                f"weights-{word}",
                tuning_chart(each),
                "Diamonds: all weights fitted, at the mean of those of conductances.",
            ),
            Picture(
                f"weights-{word}-difference",
                each.picture(),
                f"{each.name}: surface less the full volume's at the end, with weights "
                "of 1, one tuned, and all fitted. The sun shines from the side held "
                "out; red is too warm.",
            ),
        ]
    parts += [_fitted_table(found), _card_weights(cards), card_table(cards), _ABOUT]
    numbers = {each.name: _numbers(each) for each in found}
    return Finding(verdict, reason, rows, {}, chosen, tuple(parts), numbers)


_NAMES = (SHELL, LEVELS, NESTED)
_ABOUT = Note(
    "Cards of the package (`calibrate show --shipped`, made by `make cards`): largest "
    "errors in kelvin against finer voxels, with weights of 1 to those with the card's."
)


def _verdict(found: list[Tuned]) -> tuple[Verdict, str]:
    """Outcome of one weight alone, which is what the thesis tunes, and of all."""
    gains = {
        kind: [
            1 - each.worst(kind, group) / each.worst(UNTUNED, group)
            for each in found
            for group in _GROUPS
        ]
        for kind in (BY_HAND, FITTED)
    }
    near = {
        kind: [e.name for e in found if all(e.worst(kind, g) <= _NEAR for g in _GROUPS)]
        for kind in gains
    }
    listed = {kind: ", ".join(names) or "none" for kind, names in near.items()}
    words = (
        f"One conduction weight takes {from_to(gains[BY_HAND], '.0%')} off the error, "
        f"all weights, of capacities too, {from_to(gains[FITTED], '.0%')}. Within "
        f"{_NEAR:g} % of the full volume come, by one weight: {listed[BY_HAND]}; by "
        f"all: {listed[FITTED]}."
    )
    if min(gains[BY_HAND]) > 0 and len(near[BY_HAND]) == len(found):
        return Verdict.REPRODUCED, words
    better = min(gains[FITTED]) > 0
    return Verdict.DIFFERENT if better else Verdict.CONTRADICTED, words


def _sentence(each: Tuned) -> str:
    of = lambda kind, group: significant(each.worst(kind, group))
    all_of = lambda group: " to ".join(of(kind, group) for kind in _KINDS)
    return (
        f"{each.name[0].upper()}{each.name[1:]}: {all_of(TRAIN)} % on the loads it was "
        f"tuned on and {all_of(HELD_OUT)} % on the one held out; the one weight is "
        f"{each.factor:.3g}."
    )


def _card_sentence(cards: Iterable[FitCard]) -> str:
    gains = [
        1 - both["fitted"] / both["default"]
        for card in cards
        for group, both in card.error_kelvin.items()
        if group == HELD_OUT
    ]
    return (
        f"The {len(gains)} shipped cards of octrees and shells over a core take "
        f"{from_to(gains, '.0%')} off the error of the load held out."
    )


def _weight_words(each: Tuned, kind: str) -> str:
    if kind == UNTUNED:
        return f"{each.nodes:,} nodes"
    if kind == BY_HAND:
        return f"factor {each.factor:.3g}"
    return _listed(each.weights)


def _listed(weights: dict[str, Any]) -> str:
    short = lambda name: name.removeprefix("weights.").replace("_", " ")
    digits = lambda value: ", ".join(f"{v:.3g}" for v in np.atleast_1d(value))
    return "; ".join(f"{short(name)} {digits(v)}" for name, v in weights.items())


def _fitted_table(found: list[Tuned]) -> Table:
    errors = lambda each, group: " / ".join(
        significant(each.worst(kind, group)) for kind in _KINDS
    )
    rows = [
        [
            each.name,
            f"{each.nodes:,}",
            *(errors(each, group) for group in _GROUPS),
            Cell(_listed(each.weights), wraps=True),
        ]
        for each in found
    ]
    columns = ["structure", "nodes", *(f"{w} [%]" for w in _GROUPS.values())]
    title = "Weights of the thesis' structures"
    caption = f"Errors with {' / '.join(_KINDS)}."
    return Table([*columns, "fitted weights"], rows, title, caption, left=(0, 4))


def _card_weights(cards: dict[str, FitCard]) -> Table:
    recipes = {recipe.name: recipe for recipe in read_recipes(CONFIGS / "cards")}
    rows = []
    for name, card in cards.items():
        weights = {k: np.asarray(v) for k, v in vars(card.weights).items()}
        plain = {"nearest_capacity": 0.0, "non_orthogonal": 0.0}
        own = {k: v for k, v in weights.items() if (v != plain.get(k, 1.0)).any()}
        made = card.origin
        rows.append(
            [
                name,
                _pitches(recipes[name].load()) if name in recipes else "",
                Cell(_listed(own), wraps=True),
                Cell(
                    f"{made['train']}, held out {made['held_out']}; config "
                    f"{made['config']}, program {made['program']}, jaxthermo "
                    f"{made['jaxthermo']}",
                    wraps=True,
                ),
            ]
        )
    columns = ["card", "pitch [mm]", "weights that are not 1 (or 0)", "made of"]
    return Table(columns, rows, "Weights of the shipped cards", left=(0, 2, 3))


def _pitches(config: Any) -> str:
    """Edges of the voxels of all cases [mm]."""
    found = []
    for case in (*config.train, *config.held_out):
        made = changed_config(config.scene, config.set, case.set, find_meshes=False)
        body: Any = made.bodies[0]
        height = (body.mesh or body.shape).height
        found.append(1e3 * height / body.voxels_high)
    return ", ".join(f"{pitch:.3g}" for pitch in sorted(found))


def _numbers(each: Tuned) -> dict[str, Any]:
    return {
        "nodes": each.nodes,
        "factor": each.factor,
        "weights": each.weights,
        "curve": each.curve,
        "worst_percent": {
            kind: {group: each.worst(kind, group) for group in _GROUPS}
            for kind in _KINDS
        },
    }


EXHIBIT = Exhibit(
    name="section-5.2-weights",
    title="tuned conduction weights beside weights of 1",
    place="5.2",
    claims=("C16",),
    measure=_measure,
)
