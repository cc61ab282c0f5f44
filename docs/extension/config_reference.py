"""Markdown of a config reference from a JSON Schema: a table for each object."""

import json
import re
from pathlib import Path
from typing import Any


_TEXT_WITH_UNIT = "text with unit"
CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def config_reference(name: str) -> str:
    """Fields of `configs/NAME.schema.json` with units, defaults and descriptions."""
    schema = json.loads((CONFIGS / f"{name}.schema.json").read_text())
    sections = [_fields(name, schema)]
    for key, definition in schema.get("$defs", {}).items():
        text = f"({_label(name, key)})=\n## {_title(key, definition)}\n"
        words = definition.get("description")
        sections.append(f"{text}\n{_escape(words)}\n" if words else text)
        sections.append(_fields(name, definition))
    return "\n".join(sections)


def _label(name: str, key: str) -> str:
    return f"{name}-{key}".lower()


def _title(key: str, definition: dict[str, Any]) -> str:
    """The words of a type's name, and its kind."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", key.removesuffix("Config"))
    type_kind = definition.get("properties", {}).get("kind", {}).get("const")
    return f"{words} (`kind: {type_kind}`)" if type_kind else words


def _fields(name: str, schema: dict[str, Any]) -> str:
    properties = schema.get("properties", {})
    rows = ["| field | value | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, field in properties.items():
        if key == "kind" and "const" in field:
            continue
        row = (
            f"`{key}`",
            _value(name, field),
            _unit(field),
            _default(key, field, schema),
            _escape(field.get("description", "")),
        )
        rows.append("| " + " | ".join(row) + " |")
    rows.append("")
    groups = [
        ", ".join(f"`{_key(option)}`" for option in group["oneOf"])
        for group in schema.get("allOf", [])
        if "oneOf" in group
    ]
    rows += [f"Exactly one of {group} is given.\n" for group in groups]
    return "\n".join(rows) if len(rows) > 3 or groups else "No fields.\n"


def _key(condition: dict[str, Any]) -> str:
    """The key that a condition requires, with a dot if it is in a nested mapping."""
    (outer,) = condition["required"]
    inner = condition.get("properties", {}).get(outer)
    return outer if inner is None else f"{outer}.{_key(inner)}"


def _value(name: str, field: dict[str, Any]) -> str:
    """The values that a field takes, types of objects as links."""
    options = list(dict.fromkeys(o for o in _options(name, field) if o))
    # Every number may be a text with its unit, which the head of the reference says.
    if any(option.startswith(("number", "integer")) for option in options):
        options = [option for option in options if option != _TEXT_WITH_UNIT]
    return " or ".join(options)


def _options(name: str, field: dict[str, Any]) -> list[str]:
    if "$ref" in field:
        key = field["$ref"].rsplit("/", 1)[1]
        title = _title(key, {})
        return [f"[{title}](#{_label(name, key)})"]
    if "const" in field:
        return [f"`{field['const']}`"]
    if "enum" in field:
        return [" or ".join(f"`{value}`" for value in field["enum"])]
    for group in ("anyOf", "oneOf"):
        if group in field:
            return [o for option in field[group] for o in _options(name, option)]
    json_type = field.get("type")
    if json_type == "array":
        items = field.get("items") or (field.get("prefixItems") or [{}])[0]
        count = field.get("minItems")
        exact = count is not None and count == field.get("maxItems")
        head = f"{count} of" if exact else "list of"
        return [f"{head} ({_value(name, items)})"]
    if json_type == "object":
        inside = field.get("additionalProperties")
        values = _value(name, inside) if isinstance(inside, dict) else ""
        return [f"names with ({values})" if values else "mapping"]
    if json_type == "string":
        return ["text" if "pattern" not in field else _TEXT_WITH_UNIT]
    words = {"null": "", "boolean": "true or false"}
    return [
        words.get(str(json_type), (str(json_type) if json_type else "") + _range(field))
    ]


def _range(field: dict[str, Any]) -> str:
    signs = {
        "minimum": ">=",
        "exclusiveMinimum": ">",
        "maximum": "<=",
        "exclusiveMaximum": "<",
    }
    limits = [f"{sign} {field[key]}" for key, sign in signs.items() if key in field]
    return " " + ", ".join(limits) if limits else ""


def _unit(field: dict[str, Any]) -> str:
    """The unit anywhere inside a field, if there is one."""
    units = set(re.findall(r'"unit": "([^"]+)"', json.dumps(field)))
    return ", ".join(sorted(units)).replace("|", r"\|")


def _default(key: str, field: dict[str, Any], schema: dict[str, Any]) -> str:
    if key in schema.get("required", []):
        return "required"
    value = field.get("default")
    if value is None:
        return ""
    text = json.dumps(value, ensure_ascii=False)
    return f"`{text}`" if len(text) < 60 else "its own defaults"


def _escape(text: str) -> str:
    """Text of a docstring as Markdown of a table cell."""
    pieces = text.split("`")
    pieces[::2] = [re.sub(r"([*_<|\[\]])", r"\\\1", piece) for piece in pieces[::2]]
    return "`".join(pieces).replace("\n", " ")
