"""Settings shared by all tests: float64, strict promotion, real meshes if present."""

import gc
import hashlib
import os
import platform
import shutil
from importlib.metadata import version
from pathlib import Path

import jax
import pytest
from hypothesis import settings

from tests.xla_flags import FAST_COMPILATION


ROOT = Path(__file__).resolve().parents[1]
MAX_COMPILATION_CACHE_BYTES = 500_000_000


def _compilation_cache() -> Path:
    """Folder of compiled programs, shared by all test processes, kept between runs."""
    # Code compiled for another processor or by another jaxlib can crash when loaded,
    # which JAX's own key does not rule out: those two name the folder.
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    processor = [line for line in lines if line.startswith(("model name", "flags"))]
    text = "\n".join([platform.machine(), platform.processor(), *processor[:2]])
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    return ROOT / ".jax_cache" / f"{version('jaxlib')}-{digest}"


# The long tests run as users do: `make slow` and .ci/run set XLA_FLAGS to nothing.
os.environ.setdefault("XLA_FLAGS", FAST_COMPILATION)
# In the environment, so that the commands that tests start share it too.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_compilation_cache()))
# Most programs here compile in under the second from which JAX keeps them by default.
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# JAX reads the environment when it is imported, which a plugin may have done before.
jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
# No operation says which lines of Python it comes from: the stack below a test is deep,
# and every program would hold all of it.
jax.config.update("jax_traceback_in_locations_limit", 0)
# The same examples in every run, so that a change fails on what it changed. A search
# for new ones: pytest --hypothesis-profile=default.
settings.register_profile("same_examples", derandomize=True)
settings.load_profile("same_examples")


def pytest_configure(config: pytest.Config) -> None:
    """The first process empties the compilation cache when it has grown too large."""
    folder = ROOT / ".jax_cache"
    if hasattr(config, "workerinput") or not folder.exists():
        return
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    if size > MAX_COMPILATION_CACHE_BYTES:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is imported stays: nobody looks for garbage in it, now or later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
        # Traces make many objects that stay: looked through every 700, they take a
        # tenth of the time of a test.
        gc.set_threshold(20_000, 20, 20)


def pytest_sessionfinish() -> None:
    """What is left ends with the process: nobody looks for garbage in it, either."""
    gc.freeze()


def _mesh_folders() -> list[Path]:
    named = os.environ.get("JAXTHERMO_MESHES")
    return [Path(named)] if named else [ROOT.parent / "shared" / "meshes"]


@pytest.fixture(scope="session", autouse=True)
def structures_kept_for_the_session_only(tmp_path_factory):
    """Structures are cached in a folder of this run, never in the user's own."""
    os.environ["JAXTHERMO_CACHE"] = str(tmp_path_factory.mktemp("cache"))


MOST_MAPPED = 45_000
"""Pieces of memory; a process may have 65 530, and crashes without a word beyond."""


@pytest.fixture(scope="module", autouse=True)
def programs_do_not_pile_up():
    """Every compiled program holds some pieces until it is forgotten."""
    yield
    mapped = Path("/proc/self/maps")
    if mapped.exists() and mapped.read_text().count("\n") > MOST_MAPPED:
        jax.clear_caches()


@pytest.fixture
def real_mesh():
    """A function from a file name to the path of a real mesh, skipping without it."""

    def find(name: str) -> Path:
        for folder in _mesh_folders():
            if (folder / name).is_file():
                return folder / name
        pytest.skip(f"{name} is not in JAXTHERMO_MESHES or ../shared/meshes")

    return find
