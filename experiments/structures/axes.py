"""Colours that stay with their structure in every chart."""

from typing import Any

import altair as alt

from .config import FULL, LINKS


SHADES = {
    FULL: ("#14171d", "#14171d"),
    LINKS: ("#868d99", "#868d99"),
    "single_shell": ("#a31621", "#f2877a"),
    "multi_level": ("#b8500a", "#f5b942"),
    "irregular_multi_level": ("#4c7a12", "#a9cf62"),
    "octree": ("#0b6e5f", "#58c4b0"),
    "aggregate": ("#17358c", "#6db1f2"),
    "shell_over_core": ("#66228f", "#c78be6"),
}
"""The darkest and the lightest of each kind of structure."""

OTHER = ("#6b4423", "#cfa27c")
"""Of kinds that are not listed."""

ALONE = 0.3
"""Between the two, where a kind has one structure only."""

Paint = dict[str, str]
"""The colour of each label."""


def colours(kinds: dict[str, str]) -> Paint:
    """A hue for each kind of structure, and in it a shade for each label.

    Args:
        kinds: of all labels, in the order in which the shades get lighter.
    """
    paint = {}
    for kind in dict.fromkeys(kinds.values()):
        labels = [label for label in kinds if kinds[label] == kind]
        for i, label in enumerate(labels):
            share = i / (len(labels) - 1) if len(labels) > 1 else ALONE
            paint[label] = _mixed(*SHADES.get(kind, OTHER), share)
    return paint


def _mixed(dark: str, light: str, share: float) -> str:
    """A colour that share of the way from one to the other."""
    ends = [[int(text[i : i + 2], 16) for i in (1, 3, 5)] for text in (dark, light)]
    mixed = (round(a + share * (b - a)) for a, b in zip(*ends, strict=True))
    return "#" + "".join(f"{value:02x}" for value in mixed)


def colour(shown: list[str], paint: Paint, **how: Any) -> alt.Color:
    """The colour of each label that is shown, in that order."""
    scale = alt.Scale(domain=shown, range=[paint[label] for label in shown])
    return alt.Color("label", type="nominal", scale=scale, sort=None, **how)
