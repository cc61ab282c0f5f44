"""Names of the parts of a mesh file, patterns of names, and rules by them."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from ..errors import InputError
from .files.file_mesh import ABSENT


def matching_parts(pattern: str, names: Iterable[str]) -> list[str]:
    """Names of parts that a pattern stands for.

    A pattern with a "/" is that of a whole name. One without matches the node, the mesh
    or the material. In it "*" stands for any characters, and "?" for one.
    """
    names = list(names)
    if pattern in names:
        return [pattern]
    expression = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    if "/" in pattern:
        return [name for name in names if re.fullmatch(expression, name)]
    return [
        name
        for name in names
        if any(re.fullmatch(expression, word) for word in _words(name))
    ]


def _words(name: str) -> list[str]:
    return [name, *re.sub(r"#\d+$", "", name).split("/")]


def short_names(names: Sequence[str]) -> list[str]:
    """The first word of each name of a part, or all of it where others have that word.

    The first word is the node, else the mesh or the material that the file names.
    """
    firsts = [_first_word(name) for name in names]
    count = Counter(firsts)
    return [
        first if count[first] == 1 else name
        for first, name in zip(firsts, names, strict=True)
    ]


def _first_word(name: str) -> str:
    _, *words = _words(name)
    return next((word for word in words if word != ABSENT), name)


_MAX_LISTED = 12
"""Largest number of names of parts in a message."""


def pattern_of_parts(
    names: list[str], patterns: list[str], argument: str
) -> dict[str, str]:
    """The pattern that is for each part, by the part's name.

    A pattern without "/" matches the node, the mesh or the material of a part; "*" is
    for all parts that nothing else names.

    Raises:
        InputError: for a part of no or of several patterns, or a pattern of no part.
    """
    listed = _listed_names(names)
    pattern_of: dict[str, str] = {}
    for pattern in patterns:
        matching = [] if pattern == "*" else matching_parts(pattern, names)
        if not matching and pattern != "*":
            raise InputError(
                f"{argument}: there is no part {pattern!r}; there are {listed}"
            )
        for name in matching:
            earlier = pattern_of.setdefault(name, pattern)
            # A whole name says more than a pattern.
            if name == pattern:
                pattern_of[name] = pattern
            elif earlier not in (name, pattern):
                raise InputError(
                    f"{argument}: both {earlier!r} and {pattern!r} match the part "
                    f"{name!r}: give its whole name"
                )
    missing = [name for name in names if name not in pattern_of]
    if missing and "*" not in patterns:
        raise InputError(
            f"{argument}: the part {missing[0]!r} has none: give one for each of "
            f"{listed}, or '*' for all others"
        )
    return {name: pattern_of.get(name, "*") for name in names}


def _listed_names(names: Sequence[str]) -> str:
    """Names of parts in a message: "roof, door and 58 more"."""
    listed = ", ".join(names[:_MAX_LISTED])
    if len(names) > _MAX_LISTED:
        listed += f" and {len(names) - _MAX_LISTED:,} more (jaxthermo parts lists them)"
    return listed


def unmatched_name(pattern: str, names: Sequence[str]) -> str:
    """Message that no body has a name that a pattern stands for."""
    existing = f"there are {_listed_names(names)}" if names else "none has one"
    return f"no body has the name {pattern!r}; {existing}"


class _RuleFault(NamedTuple):
    """A rule that does nothing, or parts without a rule."""

    rule: int | None
    """Number of the rule; None for parts without one."""
    line: str


class _AssignedRules(NamedTuple):
    """Rules of parts."""

    rule_of: dict[str, int]
    """Number of the rule of each part by its name, in the order of the parts."""
    faults: list[_RuleFault]


def assign_rules(
    rules: Sequence[Sequence[str]], short: Mapping[str, str]
) -> _AssignedRules:
    """Find the first rule that matches each part.

    Args:
        rules: patterns of names of each rule, as in `matching_parts`; a short name is
            a pattern of this part alone.
        short: names of all parts, with their short names.
    """
    rule_of: dict[str, int] = {}
    faults = []
    for number, patterns in enumerate(rules):
        count = len(rule_of)
        unmatched = []
        for pattern in patterns:
            matching = [name for name in short if pattern == short[name]]
            matching = matching or matching_parts(pattern, short)
            if not matching:
                unmatched.append(pattern)
            for name in matching:
                rule_of.setdefault(name, number)
        if unmatched:
            existing = _listed_names(list(short.values()))
            line = f"there is no part {unmatched[0]!r}; there are {existing}"
            faults.append(_RuleFault(number, line))
        # One for all that is left may find nothing left.
        elif len(rule_of) == count and "*" not in patterns:
            line = "earlier rules match all of its parts: move it up, or remove it"
            faults.append(_RuleFault(number, line))
    missing = [short[name] for name in short if name not in rule_of]
    # A pattern that matches nothing explains parts without a rule.
    if missing and not faults:
        line = (
            f"no rule is for {_listed_names(missing)}: give one, or '*' for all others"
        )
        faults.append(_RuleFault(None, line))
    in_order = {name: rule_of[name] for name in short if name in rule_of}
    return _AssignedRules(in_order, faults)
