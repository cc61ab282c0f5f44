"""The code says what its values are: limits on names, packing, lengths and imports.

`tests/tools/count_words.py` says what each word of the table means.
"""

import ast
from pathlib import Path

import pytest

from tests.tools.count_words import Words, count_folder, count_source


ROOT = Path(__file__).resolve().parents[2]

MAX_FILE_LINES = 500
MAX_FUNCTION_LINES = 90
MAX_TOKENS_PER_LINE = {"jaxthermo": 9.2, "calibrate": 8.5, "experiments": 8.62}
"""The aim is 8.5 for each: these numbers only fall."""
MAX_VAGUE_PERCENT = {"jaxthermo": 1.0, "calibrate": 1.0, "experiments": 1.0, "tests": 2}
MAX_PARALLEL_PER_THOUSAND = 5.0
MAX_NAMED_LAMBDAS = {"jaxthermo": 1, "calibrate": 0, "experiments": 0, "tests": 19}
MAX_UNTYPED_RECORDS = {"jaxthermo": 30, "calibrate": 11, "experiments": 22, "tests": 4}
"""The aims are 24, 12, 42 and 4: these numbers only fall."""
MAX_SPLATS = {"jaxthermo": 3, "calibrate": 0, "experiments": 0, "tests": 0}
LONG_FUNCTIONS = {
    "jaxthermo": [],
    "calibrate": [],
    "experiments": ["_loops"],
    "tests": [],
}
"""Functions that are still too long; the list only gets shorter."""

PRODUCT = ("jaxthermo", "calibrate", "experiments")
PACKAGES = (*PRODUCT, "tests")


@pytest.fixture(scope="module")
def words() -> dict[str, Words]:
    """Counts of each package."""
    return {package: count_folder(ROOT / package) for package in PACKAGES}


@pytest.mark.parametrize("package", PACKAGES)
def test_names_say_what_a_value_is(words, package):
    assert words[package].vague_percent <= MAX_VAGUE_PERCENT[package]


@pytest.mark.parametrize("package", PACKAGES)
def test_one_statement_stands_in_one_line(words, package):
    assert words[package].parallel_per_thousand <= MAX_PARALLEL_PER_THOUSAND


@pytest.mark.parametrize("package", PACKAGES)
def test_no_arguments_are_gathered_only_to_be_splatted(words, package):
    assert words[package].splats <= MAX_SPLATS[package]


@pytest.mark.parametrize("package", PACKAGES)
def test_functions_with_a_name_are_defined(words, package):
    assert words[package].named_lambdas <= MAX_NAMED_LAMBDAS[package]


@pytest.mark.parametrize("package", PACKAGES)
def test_results_have_fields(words, package):
    assert words[package].untyped_records <= MAX_UNTYPED_RECORDS[package]


@pytest.mark.parametrize("package", PRODUCT)
def test_a_line_of_the_product_is_not_packed(words, package):
    assert words[package].tokens_per_line <= MAX_TOKENS_PER_LINE[package]


def sources(package: str) -> dict[str, str]:
    """Text of each file of a package."""
    files = sorted((ROOT / package).rglob("*.py"))
    return {str(f.relative_to(ROOT)): f.read_text(encoding="utf-8") for f in files}


@pytest.mark.parametrize("package", PACKAGES)
def test_files_and_functions_are_not_too_long(package):
    long_files, long_functions = [], []
    for name, source in sources(package).items():
        if source.count("\n") > MAX_FILE_LINES:
            long_files.append(name)
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > MAX_FUNCTION_LINES:
                    long_functions.append(node.name)
    assert not long_files
    assert set(long_functions) <= set(LONG_FUNCTIONS[package])


@pytest.mark.parametrize("package", PRODUCT)
def test_names_with_an_underscore_stay_in_their_module(package):
    imported = [
        f"{name}: {alias.name}"
        for name, source in sources(package).items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name.startswith("_") and not alias.name.startswith("__")
    ]
    assert not imported


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("own = 1", "vague_names"),
        ("def f(given): pass", "vague_names"),
        ("[each for each in x]", "vague_names"),
        ("class Law:\n    own: float", "vague_names"),
        ("a, b = x, y", "parallel_assignments"),
        ("def f():\n    parts = a, b\n    g(*parts)", "splats"),
        ("def f():\n    parts = [a, b]\n    g(1, *parts)", "splats"),
        ("rate = lambda t: t", "named_lambdas"),
        ("rate: Rate = lambda t: t", "named_lambdas"),
        ("Row = dict[str, Any]", "untyped_records"),
        ("def f(row: dict[str, Any] | None): pass", "untyped_records"),
    ],
)
def test_each_construct_is_counted(source, count):
    assert getattr(count_source(source), count) == 1


@pytest.mark.parametrize(
    "source", ["a, b = b, a", "a, b = pair", "f(*args)", "f(lambda t: t)", "x = d[str]"]
)
def test_what_reads_well_is_not_counted(source):
    words = count_source(source)
    counted = words.parallel_assignments, words.splats, words.named_lambdas
    assert counted == (0, 0, 0)
    assert words.vague_names == 0
    assert words.untyped_records == 0


def test_tokens_are_those_of_code_alone():
    words = count_source('"""Text."""\n# Reason.\nx = 1\n\ny = f(x)\n')
    assert words.tokens == 3 + 6
    assert words.code_lines == 2
