"""`experiments run accelerator`: the benchmark of GPUs, on a small body and here."""

import json

import jax
import pytest

import jaxthermo as jt
from experiments import catalogue
from experiments.benchmarks import accelerator


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:body 0 represents")
@pytest.mark.filterwarnings("ignore:.*cavities that are closed")
def test_every_quantity_is_measured(tmp_path, monkeypatch):
    structures = {
        name: accelerator._STRUCTURES[name] for name in ("blocks x4", "octree")
    }
    monkeypatch.setattr(accelerator, "_STRUCTURES", structures)
    monkeypatch.setattr(accelerator, "_PARAMETERS", (1, 2))
    result = accelerator.run(tmp_path, 24, (8, 12, 8), repeats=2, copied=2**16)
    json.dumps(result, allow_nan=False)
    rows = result["measurements"]
    assert result["device"].startswith(jax.default_backend())
    assert [r["name"] for r in rows if min(r["ours"]) <= 0] == []
    words = " ".join(row["name"] for row in rows)
    for quantity in ("copy", "conduction", "implicit", "2 parameters", "640 x 480"):
        assert quantity in words


def test_a_device_that_is_not_there_is_refused():
    missing_device = "tpu" if jax.default_backend() != "tpu" else "gpu"
    with pytest.raises(
        jt.InputError, match=f"--device {missing_device}: JAX computes on"
    ):
        catalogue.use_device(missing_device)
