"""Count what a reader of the packages meets: files, lines, names, docstrings, imports.

    python tests/tools/count_code.py [ROOT]

Rules, the same for every package:

- A *docstring* is a string that stands alone as a statement: of a module, a class or a
  function, or under an assignment (an attribute docstring). Its physical lines are
  docstring lines.
- A *comment line* holds nothing but a comment; a *code line* is neither blank, nor a
  comment line, nor a docstring line. Lines are all physical lines.
- A *public name* is a function or class (constants are counted apart) at the top level
  of a module, without a leading underscore. It has an importer if `jaxthermo` exports
  it or its whole module, if `[project.scripts]` of pyproject.toml or the catalogue of
  experiments calls it, if another module of the three packages imports it by name, or
  if one imports its module and reads it as an attribute. Names that only tests import
  are counted apart.
- A docstring *opens* with the first word of its text; the words in OPENINGS say nothing
  of what the thing is.
- An *own import in a function* imports from the three packages inside a function.
- Comment lines per 100 and the median file are over files that hold any code beyond a
  docstring, so that an empty `__init__.py` does not improve them.
"""

import ast
import io
import statistics
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path


PACKAGES = ("jaxthermo", "calibrate", "experiments")
OPENINGS = ("Of", "What", "How", "Whether", "Where", "Yes")
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


@dataclass
class Module:
    """One file: its tree and its lines by what they hold."""

    name: str
    path: Path
    tree: ast.Module
    lines: int
    code: int
    comments: int
    docstring_lines: int
    docstrings: dict[str, list[str]]
    """Texts of its docstrings by what they belong to: `definition` or `attribute`."""
    imported: set[tuple[str, str]] = field(default_factory=set)
    """Modules and the names that this one takes from them."""


def docstrings(tree: ast.Module) -> Iterator[tuple[str, ast.Constant]]:
    """String statements with what each belongs to."""
    for parent in ast.walk(tree):
        body = getattr(parent, "body", None)
        if not isinstance(body, list):
            continue
        for index, node in enumerate(body):
            value = node.value if isinstance(node, ast.Expr) else None
            if not isinstance(value, ast.Constant) or not isinstance(value.value, str):
                continue
            first = index == 0 and isinstance(parent, (*_DEFINITIONS, ast.Module))
            yield ("definition" if first else "attribute"), value


def read_module(path: Path, root: Path) -> Module:
    """Parse a file and count its lines."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    texts: dict[str, list[str]] = {"definition": [], "attribute": []}
    documented: set[int] = set()
    for place, node in docstrings(tree):
        texts[place].append(str(node.value))
        documented.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    rows = text.splitlines()
    commented = {
        token.start[0]
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
        and rows[token.start[0] - 1].lstrip().startswith("#")
    }
    blank = {n for n, row in enumerate(rows, 1) if not row.strip()} - documented
    names = path.relative_to(root).with_suffix("").parts
    if names[-1] == "__init__":
        names = names[:-1]
    return Module(
        name=".".join(names),
        path=path,
        tree=tree,
        lines=len(rows),
        code=len(rows) - len(commented | documented | blank),
        comments=len(commented),
        docstring_lines=len(documented),
        docstrings=texts,
    )


def imports(module: Module, names: set[str]) -> set[tuple[str, str]]:
    """Names that a module takes from others: by name, or as attributes of modules."""
    package = module.name.split(".")
    if module.path.name != "__init__.py":
        package = package[:-1]
    imported = set()
    modules = {}
    for node in ast.walk(module.tree):
        if not isinstance(node, ast.ImportFrom):
            continue
        base = node.module or ""
        if node.level:
            inside = package[: len(package) - node.level + 1]
            base = ".".join([*inside, *filter(None, [node.module])])
        for alias in node.names:
            imported.add((base, alias.name))
            if f"{base}.{alias.name}" in names:
                modules[alias.asname or alias.name] = f"{base}.{alias.name}"
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            home = modules.get(node.value.id)
            imported |= {(home, node.attr)} if home else set()
    return imported


def exported(root: Path) -> set[tuple[str, str]]:
    """Names that `jaxthermo` resolves, and entry points, with their modules."""
    tree = ast.parse((root / "jaxthermo" / "__init__.pyi").read_text(encoding="utf-8"))
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    scripts = project["project"]["scripts"].values()
    lines = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    names = {
        (f"jaxthermo.{line.module}", name.name) for line in lines for name in line.names
    }
    # A module that is exported, such as `shapes`, is so with all its names.
    files = {
        root.joinpath(*home.split("."), f"{name}.py"): f"{home}.{name}"
        for home, name in names
    }
    for path in filter(Path.is_file, files):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names |= {
            (files[path], node.name)
            for node in tree.body
            if isinstance(node, _DEFINITIONS)
        }
    return names | {tuple(script.split(":")) for script in scripts} | catalogued(root)


def catalogued(root: Path) -> set[tuple[str, str]]:
    """Entries of the experiments, whose modules the catalogue imports by name."""
    source = (root / "experiments" / "catalogue.py").read_text(encoding="utf-8")
    return {
        (f"experiments.{node.value}", "run")
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def public_names(module: Module) -> tuple[list[str], list[str]]:
    """Functions and classes at the top level, and constants."""
    defined = []
    constants = []
    for node in module.tree.body:
        if isinstance(node, _DEFINITIONS):
            defined.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            constants += [t.id for t in targets if isinstance(t, ast.Name)]

    def is_public(name):
        return not name.startswith("_")

    return list(filter(is_public, defined)), list(filter(is_public, constants))


def imports_in_functions(module: Module) -> list[int]:
    """Lines that import from the packages inside a function."""
    lines: set[int] = set()
    for function in ast.walk(module.tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.ImportFrom):
                    top = (node.module or "").split(".")[0]
                    lines |= {node.lineno} if node.level or top in PACKAGES else set()
    return sorted(lines)


def opens_badly(text: str) -> bool:
    """True if a docstring opens with one of the words that say nothing."""
    words = text.split()
    return bool(words) and words[0].strip(",.:;") in OPENINGS


def counts(package: str, modules: list[Module], used, tested) -> dict[str, object]:
    """Table rows of one package, by their labels."""
    in_package = [m for m in modules if m.name.split(".")[0] == package]
    real = [m for m in in_package if m.code]
    names = [(m.name, name) for m in in_package for name in public_names(m)[0]]
    constants = [(m.name, name) for m in in_package for name in public_names(m)[1]]
    code = sum(m.code for m in in_package)
    comments = sum(m.comments for m in in_package)
    texts = [text for m in in_package for text in m.docstrings["definition"]]
    attributes = [text for m in in_package for text in m.docstrings["attribute"]]
    lengths = [m.lines for m in real]
    unused = [pair for pair in names if pair not in used]
    return {
        "files": len(in_package),
        "lines": sum(m.lines for m in in_package),
        "code lines": code,
        "comment lines": comments,
        "comment lines per 100 of code": round(100 * comments / code, 1),
        "docstring lines": sum(m.docstring_lines for m in in_package),
        "median file": statistics.median(lengths),
        "longest file": max(lengths),
        "public functions and classes": len(names),
        "... neither exported nor imported": len(unused),
        "... of these imported by tests": sum(pair in tested for pair in unused),
        "public constants": len(constants),
        "... not imported": sum(pair not in used for pair in constants),
        "docstrings": len(texts),
        "... that open badly": sum(map(opens_badly, texts)),
        "... of at most 3 words": sum(len(text.split()) <= 3 for text in texts),
        "attribute docstrings": len(attributes),
        "... attributes that open badly": sum(map(opens_badly, attributes)),
        "own imports in functions": sum(
            len(imports_in_functions(m)) for m in in_package
        ),
    }


def main() -> None:
    """Print the table; with --unused, the public names that nothing imports."""
    arguments = [a for a in sys.argv[1:] if not a.startswith("--")]
    root = Path(arguments[0] if arguments else ".").resolve()
    paths = [p for package in PACKAGES for p in sorted((root / package).rglob("*.py"))]
    modules = [read_module(path, root) for path in paths]
    tests = [read_module(path, root) for path in sorted((root / "tests").rglob("*.py"))]
    names = {m.name for m in modules}
    used = exported(root).union(*(imports(m, names) for m in modules))
    tested = set().union(*(imports(m, names) for m in tests))
    if "--unused" in sys.argv:
        for module in modules:
            for name in public_names(module)[0]:
                if (module.name, name) not in used:
                    print(f"{module.name}.{name}")
        return
    tables = [
        counts(package, modules=modules, used=used, tested=tested)
        for package in PACKAGES
    ]
    print(f"{'':36}" + "".join(f"{package:>13}" for package in PACKAGES))
    for label in tables[0]:
        print(f"{label:36}" + "".join(f"{table[label]:>13}" for table in tables))


if __name__ == "__main__":
    main()
