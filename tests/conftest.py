"""Settings shared by all tests: float64, strict promotion, real meshes if present."""

import os
from pathlib import Path

import jax
import pytest


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

ROOT = Path(__file__).resolve().parents[1]


def _mesh_folders() -> list[Path]:
    named = os.environ.get("JAXTHERMO_MESHES")
    return [Path(named)] if named else [ROOT.parent / "shared" / "meshes"]


@pytest.fixture(scope="session", autouse=True)
def structures_kept_for_the_session_only(tmp_path_factory):
    """Structures are cached in a folder of this run, never in the user's own."""
    os.environ["JAXTHERMO_CACHE"] = str(tmp_path_factory.mktemp("cache"))


MOST_MAPPED = 20_000
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
