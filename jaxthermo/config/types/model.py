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
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema
from typing_extensions import override

import jaxthermo

from ...temperatures import ALLOW_EXTREME
from ..messages import MISTAKE, close_match, explain, quoted
from .quantities import Info


Location: TypeAlias = tuple[str | int, ...]
# Location in the model, and what is wrong there.
Mistake: TypeAlias = tuple[Location, str]
Data: TypeAlias = dict[str, Any]
"""A mapping of a file, before it is validated."""


class MistakesError(Exception):
    """Mistakes in data from which other values would follow."""

    def __init__(self, mistakes: list[Mistake]):
        super().__init__(mistakes)
        self.mistakes = mistakes


class Model(BaseModel):
    """A mapping in a config file.

    Class keywords, as in `class _SunConfig(Model, builds="Sun", kind="sun")`: `builds`
    names the export of `jaxthermo` whose arguments the values are, and `kind` is the
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
    """Groups of keys: exactly one key of each group must be given.

    A key in a nested mapping is written with a dot: "shape.layers".
    """

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
        """The object that the values describe; nested models are built first.

        Args:
            args: arguments before the values, such as the grid of a structure.

        Raises:
            InputError: if a file cannot be used.
        """
        return self.target()(*args, **self.arguments())

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """The message for a key that this mapping does not have."""
        return f"unknown key{close_match(key, cls.model_fields)}"

    @classmethod
    def completed(cls, data: Data, context: Any) -> Data:
        """The data with the values that follow from others, before it is validated.

        Args:
            data: of this mapping.
            context: of the validation, see `types.files`.

        Raises:
            MistakesError: for values from which nothing follows.
        """
        del context
        return data

    @classmethod
    def raw_mistakes(cls, data: Mapping[str, object]) -> Iterable[Mistake]:
        """Mistakes that can be seen before the values are validated."""
        return ()

    def mistakes(self) -> Iterable[Mistake]:
        """Mistakes between values that are valid by themselves."""
        return ()

    @model_validator(mode="wrap")
    @classmethod
    def _collect(
        cls, data: Any, handler: Callable[[Any], "Model"], info: Info
    ) -> "Model":
        # A default, or what another model has validated.
        if isinstance(data, cls):
            return data
        if not isinstance(data, dict):
            message = f"expected `key: value` lines, got {quoted(data)}"
            raise _error(cls, [((), message)])
        try:
            data = cls.completed(data, info.context)
        except MistakesError as error:
            raise _error(cls, error.mistakes) from error
        mistakes = [*_unknown(cls, data), *_groups(cls, data), *cls.raw_mistakes(data)]
        model = None
        try:
            # Pydantic stops at unknown keys; without them it checks all the others.
            fields = {k: v for k, v in data.items() if k in cls.model_fields}
            model = handler(fields)
        except ValidationError as error:
            mistakes += mistakes_in(error)
        if model is not None:
            mistakes += model.mistakes()
        if model is None or mistakes:
            # A recursive model in another model is validated twice.
            raise _error(cls, [*dict.fromkeys(mistakes)])
        return model


class TemperatureModel(Model):
    """A mapping with temperatures, which its target would check as a call in Python.

    They are checked as they are read, by the option of their file.
    """

    @override
    def arguments(self) -> dict[str, Any]:
        return {**super().arguments(), ALLOW_EXTREME: True}


def parts(annotation: Any) -> Iterator[Any]:
    """The types and markers in an annotation, at any depth."""
    yield annotation
    for argument in get_args(annotation):
        yield from parts(argument)


def field_parts(model: type[Model], key: str) -> Iterator[Any]:
    """The types and markers of one field."""
    field = model.model_fields[key]
    for marker in (field.annotation, *field.metadata):
        yield from parts(marker)


def models_within(model: type[Model]) -> set[type[Model]]:
    """The model, and all that its fields can contain."""
    models: set[type[Model]] = set()
    waiting = [model]
    while waiting:
        current = waiting.pop()
        if current not in models:
            models.add(current)
            for key in current.model_fields:
                types = (p for p in field_parts(current, key) if isinstance(p, type))
                waiting += [inner for inner in types if issubclass(inner, Model)]
    return models


def build(value: Any, *args: Any) -> Any:
    """The object of a model, also within tuples; any other value as it is."""
    if isinstance(value, Model):
        return value.build(*args)
    if isinstance(value, tuple):
        return tuple(build(item) for item in value)
    return value


def _unknown(cls: type[Model], data: Mapping[str, object]) -> list[Mistake]:
    return [
        ((str(key),), cls.unknown_key(str(key)))
        for key in data
        if key not in cls.model_fields
    ]


def _groups(cls: type[Model], data: Mapping[str, object]) -> list[Mistake]:
    mistakes: list[Mistake] = []
    for group in cls.exactly_one:
        present = [key for key in group if _is_given(data, key)]
        names = " or ".join(f"`{key}`" for key in group)
        if not present:
            mistakes.append(((), f"missing {names}: give one of them"))
        elif len(present) > 1:
            several = "both" if len(group) == 2 else "several"
            location = tuple(present[-1].split("."))
            mistakes.append((location, f"give {names}, not {several}"))
    return mistakes


def _is_given(data: object, key: str) -> bool:
    for name in key.split("."):
        data = data.get(name) if isinstance(data, dict) else None
    return data is not None


def _error(cls: type[Model], mistakes: list[Mistake]) -> ValidationError:
    details = []
    for location, message in mistakes:
        error = PydanticCustomError(MISTAKE, "{message}", {"message": message})
        details.append(InitErrorDetails(type=error, loc=location, input=None))
    return ValidationError.from_exception_data(cls.__name__.lstrip("_"), details)


class KindModel(Model):
    """A member of a union whose members take different keys."""

    # Declared first, so that it is the first key of what is written out.
    kind: str = ""

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """The message for an unknown key: it lists the keys of this kind."""
        takes = [name for name in cls.model_fields if name != "kind"]
        # The keys of the kind itself come before those that all kinds share.
        takes.sort(key=lambda name: name not in cls.__annotations__)
        keys = ", ".join(takes) or "no other keys"
        return f"unknown key: {cls.model_fields['kind'].default} takes {keys}"


def _tag(value: Any) -> str | None:
    is_data = isinstance(value, dict)
    tag = value.get("kind") if is_data else getattr(value, "kind", None)
    # In brackets, so that `messages._untagged` can remove it from a location.
    return None if tag is None else f"<{tag}>"


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
    ) -> JsonSchemaValue:
        # The tags have defaults: without `required` an editor would accept any member.
        members = handler(schema)["oneOf"]
        return {"oneOf": [member | {"required": ["kind"]} for member in members]}


@dataclass(frozen=True)
class Short:
    """Marks a mapping for which one word may stand: `octree` for `{kind: octree}`."""

    key: str
    default: str | None = None
    """Value of the key in a mapping that does not give it."""
    words: tuple[str, ...] = ()
    """Allowed words, for an editor; the kinds of the union if empty."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner = handler(source)
        return core_schema.no_info_before_validator_function(self._spell_out, inner)

    def __get_pydantic_json_schema__(
        self, schema: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        mapping = handler(schema)
        inner = schema
        while "choices" not in inner and "schema" in inner:
            inner = inner["schema"]
        member_kinds = [tag.strip("<>") for tag in inner.get("choices", ())]
        members = mapping.get("oneOf", ())
        for member_kind, member in zip(member_kinds, members, strict=True):
            if member_kind == self.default:
                del member["required"]
        words = self.words or member_kinds
        word = {"type": "string"} | ({"enum": list(words)} if words else {})
        return {"anyOf": [mapping, word]}

    def _spell_out(self, value: Any) -> Any:
        if isinstance(value, str):
            return {self.key: value}
        if self.default is not None and isinstance(value, dict):
            return {self.key: self.default, **value}
        return value


def require_nothing(schema: JsonSchemaValue) -> None:
    """Let an editor accept a mapping whose keys may come from elsewhere in the file."""
    del schema["required"]


def mistakes_in(error: ValidationError) -> list[Mistake]:
    """The mistakes that a validation found."""
    entries = error.errors(include_url=False)
    return [(_location_of(entry), explain(entry)) for entry in entries]


def _location_of(error: Mapping[str, Any]) -> tuple[str | int, ...]:
    """Location of a mistake; an unknown member of a union is at its `kind`."""
    if error["type"] == "union_tag_invalid":
        return (*error["loc"], "kind")
    return error["loc"]
