"""Mapping of the names of a table to what is built for each."""

import abc
from collections.abc import Mapping
from typing import TypeVar

from typing_extensions import override

from ..errors import InputError


_Value = TypeVar("_Value")


class AbstractNamedTable(Mapping[str, _Value]):
    """Table by name; an unknown name is an InputError, with names that are close."""

    @property
    @abc.abstractmethod
    def known_names(self) -> Mapping[str, object]:
        """Names that it has a value for, with the aliases that it does not iterate."""

    # The inherited one would build the value, and expects a KeyError.
    def __contains__(self, name: object) -> bool:
        return name in self.known_names

    @override
    def get(self, key: str, default=None):
        # The inherited one expects a KeyError, which an InputError is not.
        try:
            return self[key]
        except InputError:
            return default

    def __repr__(self) -> str:
        return f"{type(self).__name__.lstrip('_')}({', '.join(self)})"
