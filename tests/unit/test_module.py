"""Modules made quickly are those that equinox makes, and refuse the same arguments."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest
from equinox import Module
from typing_extensions import override


def _doubled(value: Any) -> Any:
    return 2 * value


def _classes(base: type) -> Any:
    """The same classes on `base`, which is that of equinox or ours."""

    class Checked(base):
        low: float
        high: float = 2.0
        label: str = eqx.field(static=True, default="a")
        weight: float = eqx.field(kw_only=True, default=1.0, converter=_doubled)

        def __check_init__(self):
            if self.low > self.high:
                raise ValueError(f"{self.low} is above {self.high}")

    class Further(Checked):
        extra: float = 7.0

        def __check_init__(self):
            if self.extra < 0:
                raise ValueError("below 0")

    return Further


OURS = _classes(Module)
EQUINOX = _classes(eqx.Module)


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ((1.0,), {}),
        ((1.0, 3.0, "b", 5.0), {}),
        ((1.0,), {"weight": 4.0, "label": "c"}),
        ((), {"extra": 1.0, "low": 0.5}),
    ],
)
def test_fields_are_those_of_equinox(args, named):
    assert _fields_of(OURS) is not None
    ours = OURS(*args, **named)
    theirs = EQUINOX(*args, **named)
    assert list(vars(ours).items()) == list(vars(theirs).items())
    assert jax.tree.leaves(ours) == jax.tree.leaves(theirs)
    with pytest.raises(AttributeError):
        ours.low = 2.0


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ((), {}),
        ((1.0,), {"low": 2.0}),
        ((1.0,), {"other": 2.0}),
        ((1.0, 2.0, "a", 3.0, 4.0), {}),
        ((3.0,), {}),
        ((1.0,), {"extra": -1.0}),
    ],
)
def test_wrong_arguments_are_refused_as_by_equinox(args, named):
    with pytest.raises((TypeError, ValueError)) as theirs:
        EQUINOX(*args, **named)
    with pytest.raises(theirs.type) as ours:
        OURS(*args, **named)

    def plain(error):
        return str(error.value).rpartition("__init__")[2]

    assert plain(ours) == plain(theirs)


def test_other_classes_are_left_to_equinox():
    class Own(Module):
        values: Any

        def __init__(self, count: int):
            self.values = np.zeros(count)

    class Abstract(Module):
        size: eqx.AbstractVar[int]

    class Counted(Module):
        counts: list = eqx.field(default_factory=list)

    class Computed(Abstract):
        @property
        @override
        def size(self) -> int:
            return 3

    assert all(
        _fields_of(module_class) is None for module_class in (Own, Abstract, Counted)
    )
    assert _fields_of(Computed) is not None
    computed: Any = Computed
    assert len(Own(3).values) == computed().size == 3
    assert Counted().counts is not Counted().counts
    with pytest.raises(TypeError):
        Abstract()  # type: ignore
