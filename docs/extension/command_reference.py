"""Markdown of a command reference from the command lines themselves."""

import re
from importlib import import_module
from inspect import Parameter, cleandoc
from typing import Any

from cyclopts import App


def command_reference(program: str) -> str:
    """The commands of `jaxthermo`, `calibrate` or `experiments` with their options."""
    app = import_module(f"{program}.__main__").app
    return "\n".join(_command(program, name, app[name]) for name in _names(app))


def _names(app: App) -> list[str]:
    return [name for name in app if not name.startswith("-")]


def _command(program: str, name: str, command: App) -> str:
    arguments = list(command.assemble_argument_collection(parse_docstring=True))
    positional = [a for a in arguments if a.index is not None and not _flag(a)]
    options = ["[OPTIONS]"] if len(positional) < len(arguments) else []
    usage = " ".join([program, name, *options, *map(_place, positional)])
    # Without the section of arguments, which the table has.
    words = cleandoc(command.help or "").split("\nArgs:")[0].strip()
    rows = [
        "| argument | default | meaning |",
        "|---|---|---|",
        *(f"| {_names_of(a)} | {_default(a)} | {_help(a)} |" for a in arguments),
    ]
    table = "\n".join(rows) if arguments else ""
    body = f"{_with_code(words)}\n\n{table}\n"
    return f"## `{program} {name}`\n\n```text\n{usage}\n```\n\n{body}"


def _flag(argument: Any) -> bool:
    return argument.name.startswith("-")


def _place(argument: Any) -> str:
    return argument.name if argument.required else f"[{argument.name}]"


def _names_of(argument: Any) -> str:
    return ", ".join(f"`{name}`" for name in argument.names)


def _default(argument: Any) -> str:
    value = argument.field_info.default
    if argument.required:
        return "required"
    told = value not in (None, (), False, Parameter.empty) and value is not True
    return f"`{value}`" if told else ""


def _help(argument: Any) -> str:
    text = (argument.parameter.help or "").replace("|", r"\|").replace("\n", " ")
    return _with_code(text)


def _with_code(text: str) -> str:
    """Text with its options as code: two hyphens would become a dash."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)
