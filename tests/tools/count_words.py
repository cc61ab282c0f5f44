"""Count how densely code is packed, and how many of its names say nothing.

    python tests/tools/count_words.py [FOLDER ...]

For each folder, of all its Python files:

- *tokens* are those of Python's tokenizer, without comments, layout and docstrings; a
  *code line* is a line that holds one of them.
- A *vague name* is a variable, an argument or a field whose name is a pronoun or an
  adjective of VAGUE: it does not say what the value is.
- A *parallel assignment* is `a, b = x, y`, unless it exchanges values.
- A *splat* is `call(*values)` of a tuple or list that the same function wrote out.
- A *named lambda* is a lambda that is assigned to a name, annotated or not.
- An *untyped record* is `dict[str, Any]`, under whatever name.
- An *exploded line* is one that only an added trailing comma keeps apart.
"""

import ast
import io
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple


PACKAGES = ("jaxthermo", "calibrate", "experiments", "tests")

_VAGUE_WORDS = """
own each found made given here there other others whole rest known more both every kept
place part parts one two this that these what kind kinds least most before after beside
chosen wanted shown taken brought acts
"""
VAGUE = frozenset(_VAGUE_WORDS.split())

_LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Words(NamedTuple):
    """Counts of one file or of several."""

    files: int = 0
    tokens: int = 0
    code_lines: int = 0
    bindings: int = 0
    vague_names: int = 0
    statements: int = 0
    parallel_assignments: int = 0
    splats: int = 0
    named_lambdas: int = 0
    untyped_records: int = 0

    @property
    def tokens_per_line(self) -> float:
        """Mean number of tokens of a code line."""
        return self.tokens / max(self.code_lines, 1)

    @property
    def vague_percent(self) -> float:
        """Fraction of the bindings that are vague [%]."""
        return 100 * self.vague_names / max(self.bindings, 1)

    @property
    def parallel_per_thousand(self) -> float:
        """Number of parallel assignments per 1000 statements."""
        return 1000 * self.parallel_assignments / max(self.statements, 1)

    def plus(self, words: "Words") -> "Words":
        """Return the sum of two counts."""
        sums = (a + b for a, b in zip(self, words, strict=True))
        return Words._make(sums)


def bound_names(node: ast.AST) -> Iterator[str]:
    """Yield the name that a node of the syntax tree binds, if it binds one."""
    match node:
        case ast.Name(id=name, ctx=ast.Store()):
            yield name
        case ast.arg(arg=name):
            yield name


def is_parallel(node: ast.AST) -> bool:
    """Return True for `a, b = x, y` that does not exchange values."""
    match node:
        case ast.Assign(targets=[ast.Tuple() as left], value=ast.Tuple() as right):
            names = {ast.unparse(element) for element in left.elts}
            values = {ast.unparse(element) for element in right.elts}
            return len(left.elts) == len(right.elts) and not names & values
    return False


def splats(function: ast.AST) -> Iterator[ast.Starred]:
    """Yield the arguments `*values` whose values the function itself gathered."""
    gathered = set()
    nodes = list(ast.walk(function))
    for node in nodes:
        match node:
            case ast.Assign(
                targets=[ast.Name(id=name)],
                value=ast.Tuple(elts=[_, *_]) | ast.List(elts=[_, *_]),
            ):
                gathered.add(name)
    for node in nodes:
        if not isinstance(node, ast.Call):
            continue
        for argument in node.args:
            match argument:
                case ast.Starred(value=ast.Name(id=name)) if name in gathered:
                    yield argument


def is_named_lambda(node: ast.AST) -> bool:
    """Return True for an assignment of a lambda to a name."""
    assigned = isinstance(node, ast.Assign | ast.AnnAssign | ast.NamedExpr)
    return assigned and isinstance(node.value, ast.Lambda)


def is_untyped_record(node: ast.AST) -> bool:
    """Return True for `dict[str, Any]`, in an annotation or as an alias of it."""
    match node:
        case ast.Subscript(
            value=ast.Name(id="dict"),
            slice=ast.Tuple(elts=[ast.Name(id="str"), ast.Name(id="Any")]),
        ):
            return True
    return False


def docstring_lines(nodes: Iterable[ast.AST]) -> set[int]:
    """Return the lines of all strings that stand alone as a statement."""
    lines: set[int] = set()
    for node in nodes:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def count_source(source: str) -> Words:
    """Count one file."""
    nodes = list(ast.walk(ast.parse(source)))
    documented = docstring_lines(nodes)
    tokens = [
        token
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type not in _LAYOUT and token.start[0] not in documented
    ]
    names = [name for node in nodes for name in bound_names(node)]
    functions = [node for node in nodes if isinstance(node, _FUNCTIONS)]
    return Words(
        files=1,
        tokens=len(tokens),
        code_lines=len({token.start[0] for token in tokens}),
        bindings=len(names),
        vague_names=sum(name in VAGUE for name in names),
        statements=sum(isinstance(node, ast.stmt) for node in nodes),
        parallel_assignments=sum(map(is_parallel, nodes)),
        splats=len({id(s) for function in functions for s in splats(function)}),
        named_lambdas=sum(map(is_named_lambda, nodes)),
        untyped_records=sum(map(is_untyped_record, nodes)),
    )


def count_folder(folder: Path) -> Words:
    """Count all Python files of a folder."""
    total = Words()
    for path in sorted(folder.rglob("*.py")):
        total = total.plus(count_source(path.read_text(encoding="utf-8")))
    return total


def main() -> None:
    """Print a line for each folder."""
    for name in sys.argv[1:] or PACKAGES:
        words = count_folder(Path(name))
        print(
            f"{name:12} {words.files:4} files {words.tokens:7} tokens, "
            f"{words.tokens_per_line:5.2f} a code line; vague names "
            f"{words.vague_percent:.2f} %, parallel assignments "
            f"{words.parallel_per_thousand:.1f} per 1000 statements, "
            f"{words.splats} splats, {words.named_lambdas} named lambdas, "
            f"{words.untyped_records} untyped records"
        )


if __name__ == "__main__":
    main()
