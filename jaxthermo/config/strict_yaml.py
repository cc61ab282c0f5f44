"""YAML without its surprises: what is written is what is meant, or it is an error.

PyYAML reads YAML 1.1, where `on` is true, `1e-3` is a string, `010` is eight and
`1:30` is ninety. Here the core schema of YAML 1.2 holds, and a key is given once.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import yaml

from ..errors import InputError


NEEDS = "a scene needs at least `bodies`"
"""End of the message for an empty file of a scene."""

_TAG = "tag:yaml.org,2002:"
_SCALARS = {
    "null": (r"(?:~|null|Null|NULL|)", lambda text: None),
    "bool": (r"(?:true|True|TRUE|false|False|FALSE)", lambda t: t.lower() == "true"),
    "int": (r"[-+]?[0-9]+", int),
    "float": (
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))",
        lambda text: float(re.sub(r"\.(?=[inIN])", "", text)),
    ),
}


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers = {}
    yaml_constructors: ClassVar[dict[str | None, Callable]] = {}


# Libyaml writes what PyYAML writes; some installations of PyYAML are without it.
_FASTEST_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_ONE_LINE = 2**31 - 1
"""Width of a line that is never broken."""


class _Dumper(_FASTEST_DUMPER):
    yaml_implicit_resolvers = {}

    # The same tuple twice would be written as an anchor, which readers stumble over.
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _scalar(convert: Callable[[str], Any]) -> Callable[[_Loader, Any], Any]:
    return lambda loader, node: convert(loader.construct_scalar(node))


def _mapping(loader: _Loader, node: Any) -> dict[str, object]:
    mapping: dict[str, object] = {}
    # PyYAML's own constructor lets a later key win without an error.
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise _problem(f"the key {key!r} must be a word", key_node)
        if key in mapping:
            raise _problem(f"the key '{key}' is given twice", key_node)
        mapping[key] = loader.construct_object(value_node, deep=True)
    return mapping


def _unknown_tag(loader: _Loader, node: Any) -> None:
    raise _problem(f"the tag {node.tag} is not allowed: write plain values", node)


def _problem(message: str, node: yaml.Node) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=message, problem_mark=node.start_mark)


def _register() -> None:
    for name, (pattern, convert) in _SCALARS.items():
        # In both, so that a text such as "1e-3" is written in quotes.
        regexp = re.compile(rf"^{pattern}$")
        for yaml_class in (_Loader, _Dumper):
            yaml_class.add_implicit_resolver(_TAG + name, regexp, None)
        _Loader.yaml_constructors[_TAG + name] = _scalar(convert)
    _Loader.yaml_constructors |= {
        _TAG + "str": _scalar(str),
        _TAG + "seq": lambda loader, node: loader.construct_sequence(node, deep=True),
        _TAG + "map": _mapping,
        None: _unknown_tag,
    }


_register()


def parse_yaml(text: str, source: str) -> Any:
    """The plain value that a YAML text stands for.

    Args:
        text: one YAML document.
        source: what to call it in a message.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = error.problem or error.context
        raise InputError(f"{source}{where}: {problem}") from error
    # The parser recurses: "[[[[..." must not end in a traceback.
    except RecursionError as error:
        raise InputError(f"{source}: nested too deeply") from error
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        problem = " ".join(str(error).split())
        raise InputError(f"{source}: not valid YAML: {problem}") from error


def read_yaml(path: Path, needs: str = NEEDS) -> dict[str, Any]:
    """The mapping in a YAML file; the error for an empty one says what it `needs`."""
    try:
        # Some editors begin a file with a byte order mark.
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (UTF-8 is expected)") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path}: cannot be read: {reason}") from error
    data = parse_yaml(text, str(path))
    if data is None:
        raise InputError(f"{path}: is empty; {needs}")
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected `key: value` lines at the top level")
    return data


def write_yaml(data: Mapping[str, object]) -> str:
    """The text that `parse_yaml` reads back to the same mapping."""
    return yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def write_flow(data: Mapping[str, object]) -> str:
    """The text of a mapping on one line."""
    text = yaml.dump(
        dict(data),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=True,
        width=_ONE_LINE,
    )
    return text.strip()
