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

from pydantic.json_schema import GenerateJsonSchema

from .types.model import Model, field_parts
from .types.quantities import Unit


# An entry of a docstring's section Args or Attributes, with its continuation lines.
_ARGUMENT = re.compile(r"^    (\w+): (.+(?:\n {8,}.+)*)", re.M)
_PACKAGES = ("jaxthermo", "calibrate", "experiments")


@functools.cache
def json_schema(model: type[Model]) -> str:
    """The JSON Schema of a config file, as indented text."""

    class Generator(GenerateJsonSchema):
        def model_schema(self, schema: Any) -> dict[str, Any]:
            return _described(schema["cls"], super().model_schema(schema))

        # Members of a union are private classes, and a schema has no such thing.
        def normalize_name(self, name: str) -> str:
            return super().normalize_name(name).lstrip("_")

    found = model.model_json_schema(schema_generator=Generator)
    found = {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}
    text = json.dumps(found, indent=1, ensure_ascii=False) + "\n"
    # The keys of generic models spell out their types: their titles are readable.
    for key, definition in found.get("$defs", {}).items():
        if "Annotated" in key:
            text = text.replace(f'/{key}"', f'/{definition["title"]}"')
            text = text.replace(f'"{key}":', f'"{definition["title"]}":')
    return text


def _described(model: type[Model], schema: dict[str, Any]) -> dict[str, Any]:
    # A model's own words go before those of the class that it builds.
    texts = _descriptions(model.target()) if model.builds else {}
    texts |= _descriptions(model)
    for key, field in schema.get("properties", {}).items():
        units = {p.symbol for p in field_parts(model, key) if isinstance(p, Unit)}
        unit = f"[{units.pop()}]" if len(units) == 1 and units != {""} else ""
        text = texts.get(key, "")
        if unit not in text:
            text = f"{text} {unit}"
        field.pop("title", None)
        if text.strip():
            field["description"] = text.strip()
    one_of = [
        {"oneOf": [{"required": [key]} for key in group]} for group in model.exactly_one
    ]
    return schema | ({"allOf": one_of} if one_of else {})


def _descriptions(thing: Any) -> dict[str, str]:
    """The docstrings of a class's attributes, or of a function's arguments, by name."""
    found: dict[str, str] = {}
    for owner in reversed(thing.__mro__) if inspect.isclass(thing) else (thing,):
        if owner.__module__.partition(".")[0] not in _PACKAGES:
            continue
        for documented in (owner, vars(owner).get("__init__")):
            text = inspect.getdoc(documented) if documented else None
            section = re.split(r"^(?:Args|Attributes):\n", text or "", flags=re.M)[1:]
            found |= dict(_ARGUMENT.findall(section[0])) if section else {}
        # Pydantic makes `Table[...]` at run time: only its origin has a source.
        generic = getattr(owner, "__pydantic_generic_metadata__", {})
        if inspect.isclass(owner) and generic.get("origin") is None:
            found |= _attribute_docstrings(owner)
    return {key: " ".join(text.split()) for key, text in found.items()}


# Python keeps no docstring of an attribute: only the source has it.
def _attribute_docstrings(owner: type) -> dict[str, str]:
    source = textwrap.dedent(inspect.getsource(owner))
    (definition,) = ast.parse(source).body
    assert isinstance(definition, ast.ClassDef)
    found = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match text:
                case ast.Expr(value=ast.Constant(value=str() as words)):
                    found[field.target.id] = words
    return found
