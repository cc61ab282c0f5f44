"""Settings shared by all tests: float64, strict promotion, real meshes if present."""

import os
from pathlib import Path

import jax
import pytest


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

ROOT = Path(__file__).resolve().parents[1]

# More than half of the time is compilation: programs are kept from one test, process
# and run to the next.
jax.config.update("jax_compilation_cache_dir", str(ROOT / ".pytest_cache" / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _mesh_folders() -> list[Path]:
    named = os.environ.get("JAXTHERMO_MESHES")
    return [Path(named)] if named else [ROOT.parent / "shared" / "meshes"]


@pytest.fixture(scope="session", autouse=True)
def structures_kept_for_the_session_only(tmp_path_factory):
    """Structures are cached in a folder of this run, never in the user's own."""
    os.environ["JAXTHERMO_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture
def real_mesh():
    """A function from a file name to the path of a real mesh, skipping without it."""

    def find(name: str) -> Path:
        for folder in _mesh_folders():
            if (folder / name).is_file():
                return folder / name
        pytest.skip(f"{name} is not in JAXTHERMO_MESHES or ../shared/meshes")

    return find
