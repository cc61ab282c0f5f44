"""Hundreds of damaged files: no traceback, no hang; status 2, or a result that is sane.

The same files every time: the seed of each is in the message of a failure.
"""

import json
import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import trimesh
from bodies import bar
from cli_runs import files, run, sets

import jaxthermo as jt
from calibrate.__main__ import main as calibrate
from calibrate.config.fit_record import write_fit
from jaxthermo.archive import write_archive
from jaxthermo.config.card_file import write_card
from jaxthermo.image.files.exr import read_exr, write_channels
from jaxthermo.integrate.run.solution_arrays import (
    FORMAT_VERSION as SOLUTION_VERSION,
    json_array,
)
from jaxthermo.report import voxel_sheet
from tests.calibrating import RESULT
from tests.damaged import damage, damage_archive, damage_record


SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 2 cm]}
    pitch: 1 cm
    structure: octree
    material: {name: copper, emissivity: 0.9}
    temperature: 300
    pose: {translation: [0, 0, 1 cm], rotation: {axis: [0, 0, 1], angle: 30 deg}}
terms:
  - {kind: sun, direction: [-0.5, 0.6, -0.7], irradiance: 5 kW/m^2, until: 5}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
  - {kind: surroundings, temperature: {times: [0, 10], values: [280, 290]}}
time: {end: 20, save_at: [5, 20]}
solver: {kind: forward_euler, dt: 0.1}
camera: {position: [1, -1, 0.5], look_at: [0, 0, 0], width: 32, height: 24}
image: {palette: iron, quantity: apparent}
"""
MESHES = ("obj", "ply", "ply_ascii", "stl", "stl_ascii", "glb", "off")
TEXTS = ("obj", "ply_ascii", "stl_ascii", "off")
SECONDS = 60


def _mesh(folder: Path, file_type: str) -> Path:
    sphere = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    options = {"encoding": "ascii"} if file_type == "ply_ascii" else {}
    form = "ply" if file_type == "ply_ascii" else file_type
    data = sphere.export(file_type=form, **options)
    path = folder / f"sphere.{file_type.split('_')[0]}"
    path.write_bytes(data if isinstance(data, bytes) else str(data).encode())
    return path


def _solution(folder: Path) -> Path:
    grid = bar(3, 0.01)
    saved = np.array([5.0, 20.0])
    count = len(grid.fragment_area)
    body = {
        "vertices": grid.mesh.vertices, "faces": grid.mesh.faces,
        "fragment_position": grid.fragment_position,
        "fragment_normal": grid.fragment_normal, "fragment_area": grid.fragment_area,
        "pitch": 0.01, "translation": np.zeros((1, 3)), "rotation": np.eye(3)[None],
        "emissivity": 0.9, "absorptivity": 0.9,
    }  # fmt: skip
    run_arrays = {
        "times": saved, "surface_temperature": np.full((2, count), 300.0),
        "mean_temperature": np.full((2, 1), 300.0), "terms": json_array([]),
        "irradiance": np.full((2, count), 40.0), "energy": np.zeros((2, 4)),
        "energy_columns": json_array(
            [[b, kind, ""] for b in (-1, 0) for kind in ("stored", "residual")]
        ),
        "irradiance_sources": np.zeros((2, 1, count)),
        "source_spectrum": np.full((2, 1), 5800.0), "heat_flux": np.ones((2, count)),
        "heat_transfer_coefficient": np.full((2, count), 10.0),
        "probe_temperature": np.full((2, 1), 300.0), "probe_position": np.zeros((1, 3)),
        "probe_names": json_array(["core"]),
    }  # fmt: skip
    arrays = run_arrays | {f"body0_{name}": value for name, value in body.items()}
    (folder / "config.yaml").write_text(SCENE)
    write_archive(folder / "solution.npz", "solution", SOLUTION_VERSION, arrays)
    return folder / "solution.npz"


def _card(folder: Path) -> Path:
    weights = jt.ConductionWeights(links=np.linspace(0.5, 1.5, 100), within=1.2)
    card = jt.FitCard("one", {"kind": "octree"}, weights, ranges={"biot": (0.1, 0.2)})
    write_card(folder / "card.yaml", card)
    (folder / "scene.yaml").write_text(SCENE)
    return folder / "card.yaml"


def _explain(scene: Path, *change: str):
    return run("simulate", scene, "--explain", *sets(*change))


def _voxelize(folder: Path, path: Path):
    out = folder / "out"
    code, text, err = run(
        "voxelize", path, "--pitch", "1cm", "--unit", "m", "--out", out
    )
    if code == 0:
        facts = json.loads((out / "voxels.json").read_text(), parse_constant=_not_json)
        assert facts["solid_voxels"] > 0
    else:
        assert not out.exists()
    return code, text, err


def _not_json(word: str) -> float:
    raise AssertionError(f"{word} in a JSON file")


def _render(folder: Path):
    code, text, err = run("render", folder, "--out", folder / "out")
    if code == 0:
        for path in (folder / "out" / "frames").glob("*.exr"):
            assert np.isfinite(read_exr(path)[0]["temperature_K"]).all()
    else:
        assert not (folder / "out").exists() or files(folder / "out") == set()
    return code, text, err


def _exr(path: Path):
    try:
        channels, _ = read_exr(path)
    except jt.InputError as error:
        return 2, "", f"jaxthermo: {error}\n"
    assert all(image.dtype == np.float32 for image in channels.values())
    return 0, "", ""


def _damage_file(path: Path, random: np.random.Generator, is_text: bool) -> None:
    path.write_bytes(damage(path.read_bytes(), random, is_text))


def _one(damaged: str, folder: Path, random: np.random.Generator):
    """Make a file, damage it, and run the command that reads it."""
    if damaged in MESHES:
        path = _mesh(folder, damaged)
        _damage_file(path, random, damaged in TEXTS)
        return _voxelize(folder, path)
    if damaged == "scene":
        (folder / "scene.yaml").write_text(SCENE)
        _damage_file(folder / "scene.yaml", random, is_text=True)
        return _explain(folder / "scene.yaml")
    if damaged in ("solution", "config of a run"):
        path = _solution(folder)
        if damaged == "solution":
            damage_archive(path, random, "solution", SOLUTION_VERSION)
        else:
            _damage_file(folder / "config.yaml", random, is_text=True)
        return _render(folder)
    if damaged == "fit":
        write_fit(folder / "fit.json", RESULT)
        damage_record(folder / "fit.json", random, "calibration result", 1)
        return run("show", folder, main=calibrate)
    if damaged in ("card", "lists of a card"):
        path = _card(folder)
        if damaged == "card":
            _damage_file(path, random, is_text=True)
        else:
            damage_archive(folder / "card.npz", random, "list of weights", 4)
        change = f"bodies.0.structure={{kind: octree, weights: {path}}}"
        return _explain(folder / "scene.yaml", change)
    channels = {name: np.random.default_rng(1).random((12, 9)) for name in ("T", "Z")}
    write_channels(folder / "frame.exr", channels, {"units": "K"})
    _damage_file(folder / "frame.exr", random, is_text=False)
    return _exr(folder / "frame.exr")


KINDS = (*MESHES, "scene", "config of a run", "solution", "fit", "card")
KINDS += ("lists of a card", "exr", "scene")


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    """What is drawn of a mesh that was read needs no more pixels."""
    monkeypatch.setattr(voxel_sheet, "_EDGE", 40)


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    def stop(number, frame):
        raise TimeoutError(f"took more than {seconds} s")

    handler = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)


def _fault(damaged: str, seed: int, folder: Path) -> str | None:
    """Description of what went wrong with one file; None if it was well received."""
    folder.mkdir()
    try:
        with _within(SECONDS):
            code, text, err = _one(damaged, folder, np.random.default_rng(seed))
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"{type(error).__name__}: {error}"
    lines = err.splitlines()
    if code == 2 and lines and all(_is_message(line) for line in lines):
        return None
    if code == 0 and not err and "nan" not in text.lower().split():
        return None
    return f"status {code}, {text[-200:]!r}, {err[-400:]!r}"


def _is_message(line: str) -> bool:
    """A line of the program with some words, not of a traceback."""
    return line.startswith(("jaxthermo: ", "calibrate: ")) and len(line) > 20


def _check_all(seeds: range, folder: Path, file_at: Callable[[int], str]) -> None:
    faults = {}
    for seed in seeds:
        clock = time.perf_counter()
        fault = _fault(file_at(seed), seed, folder / str(seed))
        if fault is not None:
            faults[file_at(seed), seed, math.ceil(time.perf_counter() - clock)] = fault
    assert not faults, "\n".join(f"{key}: {fault}" for key, fault in faults.items())


def test_thirty_damaged_inputs(tmp_path):
    """Two of each kind."""
    _check_all(range(2 * len(KINDS)), tmp_path, lambda seed: KINDS[seed % len(KINDS)])


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(KINDS)))
def test_six_hundred_damaged_inputs(tmp_path, number):
    """Forty of each kind, other ones than the thirty."""
    seeds = range(1000 + 40 * number, 1040 + 40 * number)
    _check_all(seeds, tmp_path, lambda seed: KINDS[number])
