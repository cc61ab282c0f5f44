"""What a case is: rows of what was seen, each with its limits and a verdict.

A row holds what it is judged by: every check is a number and the range it must lie in.
NaN lies in no range, and a row without checks cannot pass.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from jaxthermo.errors import InputError


PASS, FAIL = "pass", "FAIL"
REFUSED = "refused as it must"
REPORTED = "reported"
"""Its checks are met, and what else it shows is for comparison: nothing judges it."""


class Check(NamedTuple):
    """A number and the range it must lie in."""

    what: str
    found: float
    most: float
    least: float = -math.inf

    @property
    def met(self) -> bool:
        """Whether it does; NaN never does."""
        return self.least <= self.found <= self.most

    @property
    def text(self) -> str:
        """As in "energy 2e-16 <= 1e-12"."""
        if self.least == self.most:
            return f"{self.what} {self.found:.6g} = {self.most:.6g}"
        below = "" if self.least == -math.inf else f"{self.least:.6g} <= "
        above = "" if self.most == math.inf else f" <= {self.most:.6g}"
        return f"{below}{self.what} {self.found:.3g}{above}"


class Row(NamedTuple):
    """What was seen of one thing; what does not apply is None or empty."""

    what: str
    solver: str = ""
    dtype: str = ""
    overshoot_K: float | None = None
    """Beyond the bounds of the maximum principle, at any node or fragment."""
    energy_residual: float | None = None
    newton: int | None = None
    linear: int | None = None
    compile_s: float | None = None
    run_s: float | None = None
    result: str = ""
    """Name of the run's `RESULTS`."""
    seen: str = ""
    checks: tuple[Check, ...] = ()
    if_met: str = PASS
    """The verdict where all checks are met."""

    @property
    def verdict(self) -> str:
        """Pass, FAIL, refused as it must, or reported."""
        if not all(check.met for check in self.checks):
            return FAIL
        return self.if_met if self.checks else REPORTED


class Case(NamedTuple):
    """One of the stiff and extreme cases."""

    name: str
    title: str
    holds: str
    """What must hold, with its numbers."""
    source: str
    """Where these come from."""
    measure: Callable[[], Iterable[Row]]


def rows_of(case: Case) -> Iterator[Row]:
    """The rows of a case; what breaks it is a row that fails."""
    try:
        yield from case.measure()
    except Exception as error:
        yield broken("the case itself", error)


def broken(what: str, error: Exception, solver: str = "", dtype: str = "") -> Row:
    """A row of something that raised what it must not.

    Args:
        what: was tried.
        error: that it raised.
        solver: name.
        dtype: of the scene.
    """
    words = " ".join(str(error).split())[:200]
    check = Check("raised", 1.0, 0.0)
    seen = f"{type(error).__name__}: {words}"
    return Row(what, solver, dtype, seen=seen, checks=(check,))


def refusal(
    what: str,
    call: Callable[[], object],
    says: str,
    solver: str = "",
    dtype: str = "",
) -> Row:
    """A row that is met only if the call is refused in one line that says so.

    Args:
        what: is tried.
        call: does it.
        says: is part of the message.
        solver: name.
        dtype: of the scene.
    """
    try:
        call()
    except InputError as error:
        message = str(error)
        told = Check(f"says {says!r}", float(says in message), 1.0, 1.0)
        line = Check("lines", message.count("\n") + 1, 1)
        checks = (told, line)
        return Row(what, solver, dtype, seen=message, checks=checks, if_met=REFUSED)
    except Exception as error:
        return broken(what, error, solver, dtype)
    check = Check("refused", 0.0, 1.0, 1.0)
    return Row(what, solver, dtype, seen="it was not refused", checks=(check,))
