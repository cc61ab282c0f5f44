"""Modules of which the host calls many short methods."""

from typing import TYPE_CHECKING

from equinox import Module


class AbstractHostModule(Module):
    """A module whose methods are those of plain objects.

    Equinox makes a pytree of a method each time that it is named, so that compiled
    functions may take it as an argument: that takes longer than many methods of poses
    and structures, which none of these functions takes.
    """

    if not TYPE_CHECKING:
        __getattribute__ = object.__getattribute__
