"""The stub of the package has every exported name, and a script all types."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jaxthermo


ROOT = Path(__file__).resolve().parents[2]
STUB = ROOT / "jaxthermo" / "__init__.pyi"
SCRIPT = ROOT / "tests" / "typing" / "user_script.py"


def stub_names() -> dict[str, str]:
    """Each name that the stub exports, and its module; a module of its own for both."""
    modules = {}
    for node in ast.parse(STUB.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            assert all(name.asname == name.name for name in node.names)
            modules |= {name.name: node.module for name in node.names}
        elif isinstance(node, ast.AnnAssign):
            assert isinstance(node.target, ast.Name)
            modules[node.target.id] = ""
    return modules


def test_the_stub_names_what_the_package_exports():
    modules = stub_names()
    assert sorted(modules) == sorted(vars(jaxthermo)["__all__"])
    for name, module in modules.items():
        value = getattr(jaxthermo, name)
        if module and not isinstance(value, type(ast)):
            home = sys.modules[f"jaxthermo.{module}"]
            assert getattr(home, name) is value


def test_the_package_is_typed():
    assert (ROOT / "jaxthermo" / "py.typed").is_file()


def test_the_script_uses_every_exported_name():
    used = {
        node.attr
        for node in ast.walk(ast.parse(SCRIPT.read_text()))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "jt"
    }
    assert set(vars(jaxthermo)["__all__"]) <= used


@pytest.mark.slow
@pytest.mark.slice
def test_pyright_knows_every_type_of_a_script(tmp_path):
    pyright = Path(sys.executable).with_name("pyright")
    if not pyright.is_file():
        pytest.skip("pyright is not installed")
    # Pyright reads only files below the folder of its options.
    shutil.copy(SCRIPT, tmp_path)
    options = {
        "extraPaths": [str(ROOT)],
        "typeCheckingMode": "strict",
        "pythonVersion": "3.11",
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(options))
    done = subprocess.run(
        [pyright, "-p", tmp_path, "--pythonpath", sys.executable, "--outputjson"],
        capture_output=True,
        text=True,
    )
    diagnostics = json.loads(done.stdout)["generalDiagnostics"]
    assert [
        f"{d['range']['start']['line'] + 1}: {d['message']}" for d in diagnostics
    ] == []
