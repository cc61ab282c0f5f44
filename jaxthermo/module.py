"""Base class of all frozen pytrees with methods."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import equinox as eqx


class Module(eqx.Module):
    """A module of equinox whose methods are Python's own.

    Equinox makes a pytree of every method that is looked up, for transformations that
    take it as an argument: here `as_pytree` does, for the few that need it.
    """

    # A scene that is compiled looks up a hundred methods. A pytree of each, with a
    # check of all arrays in its module, takes longer than what the methods do.
    if not TYPE_CHECKING:
        __getattribute__ = object.__getattribute__


_M = TypeVar("_M", bound=Module)


def replaced(module: _M, **fields: Any) -> _M:
    """The module with other values of some fields, of the same kinds.

    As `dataclasses.replace`, without the checks of a new module.
    """
    made = object.__new__(type(module))
    vars(made).update(vars(module), **fields)
    return made


def as_pytree(method: Callable[..., Any]) -> Callable[..., Any]:
    """The method of a module as a pytree with the arrays of its module."""
    bound: Any = method
    return eqx.Partial(bound.__func__, bound.__self__)
