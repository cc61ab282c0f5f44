"""Lines for readers, of which one stands for many that are alike."""

import re
from collections.abc import Iterable


_NAME = re.compile(r"(?<=[\d\]]) \([^()]*\)")
_NUMBER = re.compile(r"\d[\d.,]*(?:e[+-]?\d+)?")
_AXIS = re.compile(r"(?<=\bacross )[xyz]\b")

_MAX_ALIKE = 4
"""Number of lines that differ only in these, up to which all are told."""


def grouped_lines(lines: Iterable[str]) -> list[str]:
    """Lines with one line for many that differ only in bodies, axes and numbers."""
    alike: dict[str, list[str]] = {}
    for line in lines:
        plain = _AXIS.sub("", _NUMBER.sub("#", _NAME.sub("", line)))
        alike.setdefault(plain, []).append(line)
    grouped = []
    for same in alike.values():
        if len(same) <= _MAX_ALIKE:
            grouped += same
        else:
            grouped.append(f"{same[0]} - and {len(same) - 1:,} more like it")
    return grouped
