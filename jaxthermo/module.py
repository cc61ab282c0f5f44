"""Base class of all frozen pytrees with methods."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import equinox as eqx

from .arrays import plain_numbers


class _Fields(NamedTuple):
    """Fields of a class, and functions for new modules of it."""

    positional: tuple[str, ...]
    names: dict[str, None]
    defaults: dict[str, Any]
    converters: tuple[tuple[str, Callable[[Any], Any]], ...]
    checks: tuple[Callable[[Any], None], ...]


def _fields_of(cls: type) -> _Fields | None:
    """Fields of a class whose arguments are its fields; None for any other class."""
    init = cls.__init__
    code = getattr(init, "__code__", None)
    # A type checker wraps the function that dataclasses write.
    if hasattr(init, "__wrapped__") or getattr(code, "co_filename", "") != "<string>":
        return None
    missing = dataclasses.MISSING
    fields = dataclasses.fields(cls)
    plain = all(f.init and f.default_factory is missing for f in fields)
    abstract = (getattr(cls, "__abstractmethods__", ()), cls.__abstractvars__)
    if not plain or any(abstract) or hasattr(cls, "__post_init__"):
        return None
    converters = [(f.name, f.metadata.get("converter")) for f in fields]
    checks = (vars(parent).get("__check_init__") for parent in cls.__mro__)
    return _Fields(
        positional=tuple(f.name for f in fields if not f.kw_only),
        names=dict.fromkeys(f.name for f in fields),
        defaults={f.name: f.default for f in fields if f.default is not missing},
        converters=tuple(
            (name, convert) for name, convert in converters if convert is not None
        ),
        checks=tuple(check for check in checks if check is not None),
    )


_fields: dict[type, _Fields | None] = {}


class _QuickMeta(type(eqx.Module)):
    """Constructor of modules whose arguments are their fields, and nothing else."""

    # A call of a compiled simulation makes many modules. Equinox sets each field by
    # itself and searches it for mistakes of programming, which takes longer than the
    # rest of the call. Tests go through equinox, where types are checked as well.
    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        if cls not in _fields:
            _fields[cls] = _fields_of(cls)
        fields = _fields[cls]
        if fields is None or len(args) > len(fields.positional):
            return super().__call__(*args, **kwargs)
        positional = dict(zip(fields.positional, args, strict=False))
        values = fields.defaults | positional | kwargs
        repeated = not positional.keys().isdisjoint(kwargs)
        if repeated or values.keys() != fields.names.keys():
            # Equinox says what is missing or too much.
            return super().__call__(*args, **kwargs)
        for name, convert in fields.converters:
            values[name] = convert(values[name])
        module: Any = object.__new__(cls)
        vars(module).update((name, values[name]) for name in fields.names)
        for check in fields.checks:
            check(module)
        return module


def static_numbers(default: Any) -> Any:
    """Static field of plain numbers, which compiled programs take as constants."""
    return eqx.field(static=True, converter=plain_numbers, default=default)


class Module(eqx.Module):
    """A module of equinox whose methods are Python's own, and which is made quickly.

    Equinox makes a pytree of every method that is looked up, for transformations that
    take it as an argument: here `as_pytree` does, for the few that need it.
    """

    # The compilation of a scene looks up many methods. A pytree of each, with a check
    # of all arrays in its module, takes longer than the methods themselves.
    if not TYPE_CHECKING:
        __getattribute__ = object.__getattribute__


# Not in the class statement: a type checker would then take the arguments of modules
# from the constructor, and not from their fields.
if not TYPE_CHECKING:
    Module.__class__ = _QuickMeta


_M = TypeVar("_M", bound=Module)


def replaced(module: _M, **fields: Any) -> _M:
    """The module with other values of some fields, of the same kinds.

    As `dataclasses.replace`, without the checks of a new module.
    """
    copy = object.__new__(type(module))
    vars(copy).update(vars(module), **fields)
    return copy


def as_pytree(method: Callable[..., Any]) -> Callable[..., Any]:
    """The method of a module as a pytree with the arrays of its module."""
    bound: Any = method
    return eqx.Partial(bound.__func__, bound.__self__)
