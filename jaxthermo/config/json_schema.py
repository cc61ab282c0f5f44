"""JSON Schemas of the config models, with units and descriptions, for editors.

A field that says nothing of its own is described by the class that its model builds.
"""

import ast
import functools
import inspect
import json
import re
import textwrap
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from .types.model import Model, field_parts
from .types.quantities import Unit


# An entry of a docstring's section Args or Attributes, with its continuation lines.
_ARGUMENT = re.compile(r"^    (\w+): (.+(?:\n {8,}.+)*)", re.M)
_PACKAGES = ("jaxthermo", "calibrate", "experiments")


@functools.cache
def json_schema(model: type[Model]) -> str:
    """The JSON Schema of a config file, as indented text."""

    class Generator(GenerateJsonSchema):
        def model_schema(self, schema: Any) -> JsonSchemaValue:
            return _described(schema["cls"], super().model_schema(schema))

        # Members of a union are private classes, and a schema has no such thing.
        def normalize_name(self, name: str) -> str:
            return super().normalize_name(name).lstrip("_")

    document = model.model_json_schema(schema_generator=Generator)
    document = {"$schema": "https://json-schema.org/draft/2020-12/schema", **document}
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    # The keys of generic models spell out their types: their titles are readable.
    for key, definition in document.get("$defs", {}).items():
        if "Annotated" in key:
            text = text.replace(f'/{key}"', f'/{definition["title"]}"')
            text = text.replace(f'"{key}":', f'"{definition["title"]}":')
    return text


def _described(model: type[Model], schema: JsonSchemaValue) -> JsonSchemaValue:
    # A model's docstrings take precedence over those of the class that it builds.
    texts = _descriptions(model.target()) if model.builds else {}
    texts |= _descriptions(model)
    for key, field in schema.get("properties", {}).items():
        markers = field_parts(model, key)
        units = {marker.symbol for marker in markers if isinstance(marker, Unit)}
        unit = f"[{units.pop()}]" if len(units) == 1 and units != {""} else ""
        text = texts.get(key, "")
        if unit not in text:
            text = f"{text} {unit}"
        field.pop("title", None)
        if text.strip():
            field["description"] = text.strip()
    one_of = [
        {"oneOf": [_requires(key) for key in group]} for group in model.exactly_one
    ]
    return schema | ({"allOf": one_of} if one_of else {})


def _requires(key: str) -> dict[str, object]:
    """The condition that a key is given, which may be in a nested mapping."""
    outer, _, inner = key.partition(".")
    nested = {"properties": {outer: _requires(inner)}} if inner else {}
    return {"required": [outer], **nested}


def _descriptions(thing: Any) -> dict[str, str]:
    """The docstrings of a class's attributes, or of a function's arguments, by name."""
    docstrings: dict[str, str] = {}
    owners = reversed(thing.__mro__) if inspect.isclass(thing) else (thing,)
    for owner in owners:
        if owner.__module__.partition(".")[0] not in _PACKAGES:
            continue
        for documented in (owner, vars(owner).get("__init__")):
            text = inspect.getdoc(documented) if documented else None
            sections = re.split(r"^(?:Args|Attributes):\n", text or "", flags=re.M)
            if len(sections) > 1:
                docstrings |= dict(_ARGUMENT.findall(sections[1]))
        # Pydantic makes `Table[...]` at run time: only its origin has a source.
        generic = getattr(owner, "__pydantic_generic_metadata__", {})
        if inspect.isclass(owner) and generic.get("origin") is None:
            docstrings |= _attribute_docstrings(owner)
    return {key: " ".join(text.split()) for key, text in docstrings.items()}


# Python keeps no docstring of an attribute: only the source has it.
def _attribute_docstrings(owner: type) -> dict[str, str]:
    source = textwrap.dedent(inspect.getsource(owner))
    (definition,) = ast.parse(source).body
    assert isinstance(definition, ast.ClassDef)
    docstrings = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match text:
                case ast.Expr(value=ast.Constant(value=str() as words)):
                    docstrings[field.target.id] = words
    return docstrings
