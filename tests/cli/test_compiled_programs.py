"""Commands that simulate nothing compile nothing of the time loop."""

import logging

import jax
import pytest
from cli_runs import run

from jaxthermo.memo.found import forget_findings


class _Names(logging.Handler):
    """The names of all programs that JAX compiles or loads."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text.startswith("Compiling "):
            self.seen.append(text.split()[1])


@pytest.fixture
def programs(monkeypatch):
    """Programs of a command in this process, as in a new one."""
    handler = _Names()
    logger = logging.getLogger("jax")
    monkeypatch.setattr(logger, "propagate", False)
    logger.addHandler(handler)

    def of(*arguments: object) -> list[str]:
        jax.clear_caches()
        forget_findings()
        handler.seen.clear()
        with jax.log_compiles():
            code, _, err = run(*arguments)
        assert (code, err) == (0, "")
        return list(handler.seen)

    yield of
    logger.removeHandler(handler)


# Long: as JAX forgets every program, so do the tests that follow in this process.
@pytest.mark.slow
@pytest.mark.slice
def test_a_preview_compiles_nothing(programs, scene, out):
    assert not programs("simulate", scene, "--preview", "--out", out)


@pytest.mark.slow
@pytest.mark.slice
def test_only_a_run_compiles_its_time_loop(programs, scene, out):
    path = scene
    explained = programs("simulate", path, "--explain")
    simulated = programs("simulate", path, "--out", out)
    drawn = programs("render", out, "--set", "camera.width=50")
    assert "jit(_advance_all)" in set(simulated) - set(explained)
    # Few single operations besides the scene's own programs.
    assert 0 < len(explained) <= 24
    assert len(drawn) <= 6
