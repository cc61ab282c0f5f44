"""The API reference: directives of autodoc for each exported name, by its folder.

Docstrings are plain text with Google's sections and indented equations; those become
literal blocks, and single backticks code.
"""

import ast
from pathlib import Path


STUB = Path(__file__).resolve().parents[2] / "jaxthermo" / "__init__.pyi"


def exported() -> dict[str, str]:
    """Each exported name and its module in the package, in the order of the stub."""
    module_of = {}
    for node in ast.parse(STUB.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            module_of |= {name.name: node.module or "" for name in node.names}
    return module_of


def api_reference(folder: str) -> str:
    """Directives for the names that `jaxthermo/FOLDER` exports; `.` for the package."""
    names = [name for name, module in exported().items() if _folder(module) == folder]
    modules = {"shapes": "jaxthermo.geometry.shapes"}
    modules["measurements"] = "jaxthermo.image.measurements"
    lines = ["```{eval-rst}"]
    # Modules last: their members follow a heading of their own.
    for name in sorted(names, key=lambda name: name in modules):
        if name in modules:
            lines += [f".. rubric:: jt.{name}", "   :heading-level: 2", ""]
            lines += [f".. automodule:: {modules[name]}", "   :members:", ""]
        elif name in _VALUES:
            lines += [f".. autodata:: jaxthermo.{name}", "   :no-value:", ""]
        elif name[0].isupper():
            lines += [f".. autoclass:: jaxthermo.{name}", "   :members:", ""]
        else:
            lines += [f".. autofunction:: jaxthermo.{name}", ""]
    return "\n".join([*lines, "```"])


def _folder(module: str) -> str:
    first = module.split(".")[0]
    return first if (STUB.parent / first).is_dir() else "."


_VALUES = ("materials", "stacks", "bonded", "RESULTS")
_SECTIONS = ("Args:", "Raises:", "Returns:", "Attributes:", "Example:", "Yields:")


def literal_equations(lines: list[str]) -> list[str]:
    """Lines of a docstring in which indented equations are literal blocks."""
    converted: list[str] = []
    section = False
    literal = False
    for line in lines:
        indented = line.startswith("    ")
        if line and not indented:
            section = line.strip() in _SECTIONS
            literal = False
        if indented and not section and not literal:
            converted += ["::", ""]
            literal = True
        converted.append(line if literal else _escaped(line))
    return converted


def _escaped(line: str) -> str:
    """A line in which bars of absolute values are no substitutions."""
    pieces = line.split("`")
    pieces[::2] = [piece.replace("|", "\\|") for piece in pieces[::2]]
    return "`".join(pieces)
