"""The command line as a process: what help imports, statuses, a pipe that breaks."""

import subprocess
import sys


HEAVY = ("jax", "numpy", "trimesh", "colour", "pydantic", "pint", "yaml", "OpenEXR")

_HELP = f"""
import sys
from jaxthermo.__main__ import main
for command in ([], ["simulate"], ["render"], ["voxelize"], ["materials"], ["cache"]):
    try:
        main([*command, "--help"])
    except SystemExit as stopped:
        assert stopped.code == 0
found = [name for name in {HEAVY!r} if name in sys.modules]
sys.exit(", ".join(found) or None)
"""


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=60
    )


def test_help_imports_nothing_heavy():
    done = _run("-c", _HELP)
    assert done.returncode == 0, done.stderr
    for command in ("simulate CONFIG", "--set", "--pitch", "voxelize", "materials"):
        assert command.split()[0] in done.stdout


def test_a_config_is_checked_without_jax(tmp_path):
    (tmp_path / "a.yaml").write_text("bodies: []\n")
    code = f"""
import sys
from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError
try:
    load_config({str(tmp_path / "a.yaml")!r})
except InputError as error:
    print(error)
sys.exit(", ".join(n for n in ("jax", "trimesh", "colour") if n in sys.modules) or None)
"""
    done = _run("-c", code)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 2


def test_common_units_are_read_without_pint():
    code = """
import sys
from jaxthermo.config.types.quantities import LENGTH, TEMPERATURE, to_si
to_si("3 mm", LENGTH)
to_si("20 degC", TEMPERATURE)
sys.exit("pint" in sys.modules)
"""
    done = _run("-c", code)
    assert done.returncode == 0, done.stderr


def test_module_runs_and_a_mistake_has_no_traceback():
    done = _run("-m", "jaxthermo", "example", "nowhere")
    assert done.returncode == 2
    assert done.stderr.startswith("jaxthermo: there is no example 'nowhere'")
    assert done.stderr.count("\n") == 1


def test_a_broken_pipe_is_quiet():
    command = f"{sys.executable} -m jaxthermo example figurine | true"
    command += "; echo ${PIPESTATUS[0]}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=60
    )
    assert done.stderr == ""
    assert done.stdout.strip() == "141"


def test_shown_fits_wait_for_nothing_that_runs_or_draws():
    runs = ("optimistix", "jaxthermo.integrate", "calibrate.run")
    heavy = ("jax", "altair", "trimesh", *runs)
    code = f"""
import sys
from calibrate.__main__ import main
try:
    main(["show", "--shipped"])
except SystemExit as stopped:
    assert stopped.code == 0
sys.exit(", ".join(name for name in {heavy!r} if name in sys.modules) or None)
"""
    done = _run("-c", code)
    assert (done.returncode, done.stderr) == (0, "")


def test_frames_are_drawn_without_what_runs_a_scene():
    code = """
import sys
import jaxthermo.cli.frames
heavy = "jaxthermo.scene.compile", "jaxthermo.integrate.implicit", "scipy.ndimage"
sys.exit(", ".join(name for name in heavy if name in sys.modules) or None)
"""
    done = _run("-c", code)
    assert (done.returncode, done.stderr) == (0, "")
