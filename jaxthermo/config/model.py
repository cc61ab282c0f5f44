"""The base of every config model: frozen, strict, and all mistakes told at once."""

from collections.abc import Callable, Iterable
from typing import Any, ClassVar, TypeAlias

from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from .messages import MISTAKE, explain, place
from .show import close_match, show


Location: TypeAlias = tuple[str | int, ...]
Mistake: TypeAlias = tuple[Location, str]
"""Where, counted from the model, and what is wrong."""


class Model(BaseModel):
    """A mapping in a config file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    exactly_one: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of keys of which one, and only one, must be given."""

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """What to say of a key that this mapping does not have."""
        return f"unknown key{close_match(key, cls.model_fields)}"

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> Iterable[Mistake]:
        """Mistakes that can be seen before the values are understood."""
        return ()

    def mistakes(self) -> Iterable[Mistake]:
        """Mistakes between values, each of which is fine by itself."""
        return ()

    @model_validator(mode="wrap")
    @classmethod
    def _collect(cls, data: Any, handler: Callable[[Any], "Model"]) -> "Model":
        if isinstance(data, cls):
            return data
        if not isinstance(data, dict):
            message = f"expected `key: value` lines, got {show(data)}"
            raise _error(cls, [((), message)])
        found = [*_unknown(cls, data), *_groups(cls, data), *cls.raw_mistakes(data)]
        model = None
        try:
            known = {k: v for k, v in data.items() if k in cls.model_fields}
            model = handler(known)
        except ValidationError as error:
            found += [(place(e), explain(e)) for e in error.errors(include_url=False)]
        if model is not None:
            found += model.mistakes()
        if model is None or found:
            raise _error(cls, found)
        return model


def _unknown(cls: type[Model], data: dict[str, Any]) -> list[Mistake]:
    return [
        ((str(key),), cls.unknown_key(str(key)))
        for key in data
        if key not in cls.model_fields
    ]


def _groups(cls: type[Model], data: dict[str, Any]) -> list[Mistake]:
    found: list[Mistake] = []
    for group in cls.exactly_one:
        given = [key for key in group if data.get(key) is not None]
        names = " or ".join(f"`{key}`" for key in group)
        if not given:
            found.append(((), f"missing {names}: give one of them"))
        elif len(given) > 1:
            several = "both" if len(group) == 2 else "several"
            found.append((tuple(given[-1:]), f"give {names}, not {several}"))
    return found


def _error(cls: type[Model], found: list[Mistake]) -> ValidationError:
    return ValidationError.from_exception_data(
        cls.__name__,
        [
            InitErrorDetails(
                type=PydanticCustomError(MISTAKE, "{message}", {"message": message}),
                loc=where,
                input=None,
            )
            for where, message in found
        ],
    )
