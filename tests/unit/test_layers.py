"""The house rules that can be checked: imports point one way, and cost nothing."""

import ast
import functools
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import jaxthermo


ROOT = Path(__file__).resolve().parents[2]
ORDER = [
    "memo",
    "material",
    "geometry",
    "raster",
    "voxels",
    "sheets",
    "native",
    "structures",
    "parallel",
    "network",
    "physics",
    "weather",
    "scene",
    "integrate",
    "accuracy",
    "reduction",
    "image",
    "reference",
    "flow",
    "report",
    "config",
    "console",
    "live",
    "cli",
]
ENTRIES = {"__init__.py", "__main__.py"}
PACKAGES = ("jaxthermo", "calibrate", "experiments")
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
SOURCES = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py"))


def rank(folder: str) -> int:
    """Files beside the folders come before all of them."""
    return ORDER.index(folder) if folder in ORDER else -1


@functools.cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """Imports and functions of a file, in this order of a walk."""
    node_types = ast.Import | ast.ImportFrom | FUNCTIONS
    return tuple(
        n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, node_types)
    )


def imported_folders(path: Path) -> list[str]:
    """Folders of jaxthermo that a file of jaxthermo imports from."""
    folders = []
    inside = path.relative_to(ROOT / "jaxthermo").parts
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = list(inside[: len(inside) - node.level])
            names = (node.module or "").split(".") if node.module else []
            target = base + names
            if not names:
                target += [alias.name for alias in node.names]
            folders.append(target[0] if len(target) > 1 or target[0] in ORDER else "")
    return folders


def test_imports_point_one_way():
    wrong = []
    for path in SOURCES:
        names = path.relative_to(ROOT).parts
        if names[0] == "jaxthermo" and len(names) > 2:
            higher = [f for f in imported_folders(path) if rank(f) > rank(names[1])]
            wrong += [f"{'/'.join(names)} imports from {folder}" for folder in higher]
    assert not wrong


def test_rooms_of_images_import_one_way():
    rooms = ["surface", "radiance", "pose", "detector", "colour", "files"]
    for number, room in enumerate(rooms):
        for path in (ROOT / "jaxthermo" / "image" / room).glob("*.py"):
            for node in nodes(path):
                if isinstance(node, ast.ImportFrom) and node.level == 2:
                    imported = (node.module or "").split(".")[0]
                    assert imported not in rooms[number + 1 :], path


def test_every_folder_is_in_the_order():
    folders = {p.name for p in (ROOT / "jaxthermo").iterdir() if p.is_dir()}
    assert folders - {"__pycache__", "data"} == set(ORDER)


def test_no_imports_inside_functions():
    """But for the command line, whose help must not wait for the libraries."""
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        if path.name != "__main__.py"
        for function in nodes(path)
        if isinstance(function, FUNCTIONS)
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert not wrong


def test_files_stay_short():
    lines = {path: len(path.read_text().splitlines()) for path in SOURCES}
    assert not {str(path): count for path, count in lines.items() if count > 500}


def test_lower_packages_do_not_know_the_higher_ones():
    for path in SOURCES:
        text = path.read_text()
        if path.is_relative_to(ROOT / "jaxthermo"):
            assert "import calibrate" not in text and "import experiments" not in text
        if path.is_relative_to(ROOT / "calibrate"):
            assert "import experiments" not in text and "from experiments" not in text
        if not path.is_relative_to(ROOT / "jaxthermo"):
            assert "jaxthermo.cli" not in text


def test_public_names_resolve():
    for name in vars(jaxthermo)["__all__"]:
        assert getattr(jaxthermo, name) is not None
    with pytest.raises(AttributeError, match="attribute nothing"):
        _ = jaxthermo.nothing  # type: ignore[attr-defined]


def run_python(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_the_package_pulls_in_no_heavy_library():
    code = (
        "import sys, jaxthermo; "
        "print(sorted({'jax','trimesh','colour','OpenEXR','pydantic','skimage','PIL'}"
        " & set(sys.modules)))"
    )
    assert run_python(code) == "[]"


@pytest.mark.slow
def test_no_matplotlib_after_importing_everything_and_drawing_a_frame(tmp_path):
    modules = [
        module.name
        for package in PACKAGES
        for module in pkgutil.walk_packages([str(ROOT / package)], f"{package}.")
        if not module.name.endswith("__main__")
    ]
    code = f"""
import importlib, importlib.util, sys
for name in {modules!r}:
    importlib.import_module(name)
import jaxthermo as jt
grid = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.1)), 0.02)
body = jt.Body(jt.FullVolume(grid), jt.materials['copper'], temperature=300.0)
solution = jt.simulate(jt.Scene((body,)), 0.0)
image = jt.render(solution, jt.Camera((1.0, 0.2, 0.3), (0.0, 0.0, 0.0), width=40))
jt.write_png(r'{tmp_path / "frame.png"}', image, 280.0, 310.0)
jt.write_exr(r'{tmp_path / "frame.exr"}', image)
assert importlib.util.find_spec('matplotlib') is None, 'matplotlib is installed'
print([name for name in sys.modules if name.split('.')[0] == 'matplotlib'])
"""
    assert run_python(code) == "[]"
    assert (tmp_path / "frame.png").is_file() and (tmp_path / "frame.exr").is_file()


def test_matplotlib_is_in_no_lock_and_no_source():
    assert 'name = "matplotlib"' not in (ROOT / "uv.lock").read_text()
    for path in SOURCES:
        for node in nodes(path):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            assert not any(n.startswith("matplotlib") for n in [*names, module])


def test_the_import_check_sees_what_it_should():
    visibility = ROOT / "jaxthermo" / "physics" / "radiation" / "visibility.py"
    assert "raster" in imported_folders(visibility)
    assert rank("raster") < rank("physics") < rank("cli")
