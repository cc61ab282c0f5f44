"""The base of every config model: strict, frozen, and built by the name of its class.

A model reports all its mistakes at once. `build` turns its values into the object that
is simulated, so that a new kind needs its class and one model that names it.
"""

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

import jaxthermo

from ..messages import MISTAKE, close_match, explain, quoted


Location: TypeAlias = tuple[str | int, ...]
# Location within the model, and what is wrong there.
Mistake: TypeAlias = tuple[Location, str]


class Model(BaseModel):
    """A mapping in a config file.

    Class keywords, as in `class _SunConfig(Model, builds="Sun", kind="sun")`: `builds`
    names what `jaxthermo` exports and the values are arguments of, and `kind` is the
    word by which a union recognizes this member.
    """

    # JSON Schemas name a member of a union as if it were not private.
    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        model_title_generator=lambda model: model.__name__.lstrip("_"),
    )

    builds: ClassVar[str] = ""
    exactly_one: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of keys of which one, and only one, must be given."""

    # Declared to a type checker only: most models are no members of a union.
    if TYPE_CHECKING:
        kind: str = ""

    def __init_subclass__(
        cls, builds: str = "", kind: str = "", **options: Any
    ) -> None:
        super().__init_subclass__(**options)
        cls.builds = builds or cls.builds
        if kind:
            # Pydantic collects the fields after this. First, so that it is the first
            # key of what is written out.
            cls.__annotations__ = {"kind": Literal[kind], **cls.__annotations__}
            cls.kind = kind

    @classmethod
    def target(cls) -> Callable[..., Any]:
        """The class or function that `build` calls."""
        # Looked up when it is called: a config is checked without importing JAX.
        return operator.attrgetter(cls.builds)(jaxthermo)

    def arguments(self) -> dict[str, Any]:
        """The target's arguments by name; its own defaults hold for what is None."""
        built = {name: build(value) for name, value in self if name != "kind"}
        return {name: value for name, value in built.items() if value is not None}

    def build(self, *args: Any) -> Any:
        """The object that the values describe, all within them built first.

        Args:
            args: passed on before the values, such as the grid of a structure.

        Raises:
            InputError: if a file that is named cannot be used.
        """
        return self.target()(*args, **self.arguments())

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """The message for a key that this mapping does not have."""
        return f"unknown key{close_match(key, cls.model_fields)}"

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> Iterable[Mistake]:
        """Mistakes that can be seen before the values are validated."""
        return ()

    def mistakes(self) -> Iterable[Mistake]:
        """Mistakes between values, each of which is valid by itself."""
        return ()

    @model_validator(mode="wrap")
    @classmethod
    def _collect(cls, data: Any, handler: Callable[[Any], "Model"]) -> "Model":
        # A default, or what another model has validated.
        if isinstance(data, cls):
            return data
        if not isinstance(data, dict):
            message = f"expected `key: value` lines, got {quoted(data)}"
            raise _error(cls, [((), message)])
        found = [*_unknown(cls, data), *_groups(cls, data), *cls.raw_mistakes(data)]
        model = None
        try:
            # Pydantic stops at unknown keys; without them it checks all the others.
            known = {k: v for k, v in data.items() if k in cls.model_fields}
            model = handler(known)
        except ValidationError as error:
            entries = error.errors(include_url=False)
            found += [(_location_of(entry), explain(entry)) for entry in entries]
        if model is not None:
            found += model.mistakes()
        if model is None or found:
            # A model that contains itself is validated twice where others contain it.
            raise _error(cls, [*dict.fromkeys(found)])
        return model


def parts(annotation: Any) -> Iterator[Any]:
    """The types and markers that an annotation is made of, at any depth."""
    yield annotation
    for part in get_args(annotation):
        yield from parts(part)


def field_parts(model: type[Model], key: str) -> Iterator[Any]:
    """The types and markers of one field."""
    field = model.model_fields[key]
    for part in (field.annotation, *field.metadata):
        yield from parts(part)


def models_within(model: type[Model]) -> set[type[Model]]:
    """The model, and all that its fields can contain."""
    found: set[type[Model]] = set()
    waiting = [model]
    while waiting:
        current = waiting.pop()
        if current not in found:
            found.add(current)
            for key in current.model_fields:
                types = (p for p in field_parts(current, key) if isinstance(p, type))
                waiting += [inner for inner in types if issubclass(inner, Model)]
    return found


def build(value: Any, *args: Any) -> Any:
    """The object of a model, also within tuples; any other value as it is."""
    if isinstance(value, Model):
        return value.build(*args)
    if isinstance(value, tuple):
        return tuple(build(item) for item in value)
    return value


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
        cls.__name__.lstrip("_"),
        [
            InitErrorDetails(
                type=PydanticCustomError(MISTAKE, "{message}", {"message": message}),
                loc=where,
                input=None,
            )
            for where, message in found
        ],
    )


class KindModel(Model):
    """A member of a union whose members take different keys."""

    # Declared first, so that it is the first key of what is written out.
    kind: str = ""

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """The keys that this kind takes: the given one may be another kind's."""
        takes = [name for name in cls.model_fields if name != "kind"]
        # The keys of the kind itself come before those that all kinds share.
        takes.sort(key=lambda name: name not in cls.__annotations__)
        keys = ", ".join(takes) or "no other keys"
        return f"unknown key: {cls.model_fields['kind'].default} takes {keys}"


def _tag(value: Any) -> str | None:
    given = value if isinstance(value, dict) else {"kind": getattr(value, "kind", None)}
    kind = given.get("kind")
    # In brackets, so that `messages._untagged` can take it out of a location.
    return None if kind is None else f"<{kind}>"


@dataclass(frozen=True)
class ByKind:
    """Marks a union of models that are distinguished by their `kind`."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        choices: dict[Any, CoreSchema] = {
            f"<{member.model_fields['kind'].default}>": handler.generate_schema(member)
            for member in get_args(source)
        }
        return core_schema.tagged_union_schema(choices, _tag)

    def __get_pydantic_json_schema__(
        self, schema: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        # The tags of the union have defaults, without which an editor would accept all.
        members = handler(schema)["oneOf"]
        return {"oneOf": [member | {"required": ["kind"]} for member in members]}


@dataclass(frozen=True)
class Short:
    """Marks a mapping for which one word may stand: `octree` for `{kind: octree}`."""

    key: str
    default: str | None = None
    """Value of the key in a mapping that does not give it."""
    words: tuple[str, ...] = ()
    """All words that are allowed, for an editor; the kinds if none are given."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner = handler(source)
        return core_schema.no_info_before_validator_function(self._spell_out, inner)

    def __get_pydantic_json_schema__(
        self, schema: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        mapping, inner = handler(schema), schema
        while "choices" not in inner and "schema" in inner:
            inner = inner["schema"]
        kinds = [tag.strip("<>") for tag in inner.get("choices", ())]
        for kind, member in zip(kinds, mapping.get("oneOf", ()), strict=True):
            if kind == self.default:
                del member["required"]
        words = self.words or kinds
        word = {"type": "string"} | ({"enum": list(words)} if words else {})
        return {"anyOf": [mapping, word]}

    def _spell_out(self, value: Any) -> Any:
        if isinstance(value, str):
            return {self.key: value}
        if self.default is not None and isinstance(value, dict):
            return {self.key: self.default, **value}
        return value


def _location_of(error: Mapping[str, Any]) -> tuple[str | int, ...]:
    """Location of an entry's mistake; an unknown member of a union is at its `kind`."""
    beyond = ("kind",) if error["type"] == "union_tag_invalid" else ()
    return (*error["loc"], *beyond)
