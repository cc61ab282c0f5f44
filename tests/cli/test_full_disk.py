"""A disk that is full: one line, status 2, no part of a file, and nothing lost."""

import contextlib
import resource
import shutil
import sys

import jax
import pytest
from cli_runs import RESULTS, files, frame_files, run, sets

from jaxthermo.__main__ import main


@contextlib.contextmanager
def largest_file(size):
    """The system refuses to let any file grow beyond a size [bytes]."""
    # As on a full disk, the write that goes beyond is cut short and the next one fails.
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    shortest = "jax_persistent_cache_min_compile_time_secs"
    compile_time = getattr(jax.config, shortest)
    # JAX would leave parts of compiled programs in its cache.
    jax.config.update(shortest, 1e9)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        jax.config.update(shortest, compile_time)


def refused(size, *arguments):
    with largest_file(size):
        code, _, err = run(*arguments)
    assert code == 2
    assert err.startswith("jaxthermo: cannot write ") and err.count("\n") == 1
    assert "File too large; give a folder that" in err or "not written whole" in err
    return err


def test_no_space_for_the_solution(finished, scene, out):
    size = (finished / "solution.npz").stat().st_size
    for left in (size // 2, size - 1):
        assert "solution.npz" in refused(left, "simulate", scene, "--out", out)
        assert files(out) == {"config.yaml"}


@pytest.mark.slow
def test_no_space_for_the_frames_leaves_all_the_rest(finished, scene, out):
    changes = sets("camera={width: 128, height: 96}")
    size = 2 * (finished / "solution.npz").stat().st_size
    assert ".exr" in refused(size, "simulate", scene, "--out", out, *changes)
    assert files(out) == RESULTS
    assert run("render", out)[0] == 0
    assert files(out) == RESULTS | frame_files()


def test_an_exr_is_whole_or_not_there(finished, tmp_path):
    """However much of it had space: OpenEXR itself ignores errors at a file's end."""
    first = "frames/t000005.00s.exr"
    size = (finished / first).stat().st_size
    for left in (0, 100, size // 2, size - 5000, size - 1):
        shutil.rmtree(tmp_path / "new", ignore_errors=True)
        err = refused(left, "render", finished, "--out", tmp_path / "new")
        assert "t000005.00s.exr" in err
        assert files(tmp_path / "new") == set()


@pytest.mark.parametrize("command", ["materials", "schema"])
def test_a_full_standard_output(command, capsys):
    with open("/dev/full", "w") as full, contextlib.redirect_stdout(full):
        with pytest.raises(SystemExit) as stopped:
            main([command])
        assert stopped.value.code == 2
        # What is left in its buffer goes nowhere.
        sys.stdout.flush()
    err = capsys.readouterr().err
    assert err == "jaxthermo: cannot write the output: No space left on device\n"
