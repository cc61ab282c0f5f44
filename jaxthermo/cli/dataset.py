"""`jaxthermo dataset`: variations of a scene as labelled frames for detector networks.

Every frame's labels are written after its images: a frame with labels is complete, and
the same command goes on with the missing frames.
"""

import importlib
import json
import multiprocessing
import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console

from ..arrays import precision
from ..atomic import write_json, write_text
from ..config.loader import load_dataset, to_yaml
from ..config.scene_file import plan_of
from ..config.schema.scene import SceneConfig
from ..console.progress import terminal_progress
from ..console.results_folder import prepare_folder, results_folder
from ..console.terminal import open_console, print_line, status
from ..errors import InputError, whole_number
from ..image.files.exr import write_exr
from ..image.files.keypoints import keypoint_labels
from ..image.files.labels import (
    FrameLabels,
    InstanceLabels,
    PartLabels,
    camera_matrices,
    coco,
    instances,
    run_lengths,
)
from ..image.files.raster_files import (
    centikelvin,
    grey_levels,
    saturated_pixels,
    write_grey,
)
from ..image.radiance.image import Image, coarsen
from ..integrate.run.abstract_solution import SOLUTION_FILE, StoredSolution
from ..integrate.run.solution import RESULTS
from ..integrate.run.solution_file import load_run
from ..report.numbers import count
from .dataset_plan import DatasetPlan, plan_dataset
from .frames import FrameCamera, chosen_frames
from .run_folder import CONFIG
from .simulate import CHECKPOINT, run_plan


_PLAN = "plan.json"
_LABELS = "labels"
_COCO = "annotations.json"
_COCO_SETS = {True: "annotations_validation.json", False: "annotations_train.json"}
"""Annotations of frames for validation, and of those for training."""
_IMAGES = ("images", "images_8bit", "masks", "parts", "depth", "radiometric")
# Percentiles of a frame that become black and white if the config has no scale.
_DARK = 0.5
_BRIGHT = 99.5
# Largest number of bodies in an 8-bit mask.
_BODIES = 255


def dataset(
    path: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    explain: bool,
    workers: int = 1,
) -> None:
    """Write the missing frames of a dataset, and their labels.

    Raises:
        InputError: for a mistake in the config, before anything is simulated; or a
            folder with another dataset.
    """
    whole_number(workers, "dataset(workers=)")
    console = open_console()
    with status(console, "checking what the cameras see"):
        plan = plan_dataset(load_dataset(path, overrides))
    total = sum(map(plan.frames_of, plan.variations))
    if explain:
        _explain(console, plan)
        return
    with results_folder(out or Path("results") / path.stem) as folder:
        _claim(folder, plan)
        try:
            _write_variations(console, plan=plan, folder=folder, workers=workers)
        except KeyboardInterrupt:
            done = len(list((folder / _LABELS).glob("*.json")))
            raise KeyboardInterrupt(
                f"stopped after {done} of {count(total, 'frame')}; the same command "
                "goes on from there"
            ) from None
        labels = sorted((folder / _LABELS).glob("*.json"))
        frames = [
            json.loads(label_path.read_text(encoding="utf-8")) for label_path in labels
        ]
        _write_annotations(plan, frames=frames, folder=folder, description=path.stem)
    print_line(console, f"{count(total, 'frame')} in {folder}, boxes in {_COCO}")


def _explain(console: Console, plan: DatasetPlan) -> None:
    total = sum(map(plan.frames_of, plan.variations))
    numbers = {"variation": len(plan.variations), "view": len(plan.views)}
    numbers["frame"] = total
    counted = ", ".join(count(number, name) for name, number in numbers.items())
    classes = ", ".join(dict.fromkeys(plan.categories))
    print_line(console, f"{counted}; classes: {classes}")
    for variation in plan.variations:
        print_line(console, f"{variation.name}: {_in_words(variation.changes)}")
    print_line(console, "every camera sees a body; nothing was simulated")


def _in_words(changes: Mapping[str, object]) -> str:
    settings = [f"{key}={json.dumps(value)}" for key, value in changes.items()]
    return ", ".join(settings) or "the scene as it is"


def _claim(folder: Path, plan: DatasetPlan) -> None:
    """Mark the folder as the dataset's; refuse that of another dataset."""
    mark = folder / _PLAN
    expected = {"digest": plan.digest}
    if mark.is_file():
        try:
            recorded = json.loads(mark.read_text(encoding="utf-8"))
        except ValueError:
            recorded = None
        if recorded != expected:
            raise InputError(
                f"--out {folder}: has frames of another dataset, or of another state "
                "of its files; name another folder, or remove it"
            )
    write_text(folder / "dataset.yaml", to_yaml(plan.config))
    write_json(mark, expected)
    for name in (_LABELS, *_IMAGES):
        if name != "parts":
            prepare_folder(folder / name)


def _write_annotations(
    plan: DatasetPlan, frames: list[Any], folder: Path, description: str
) -> None:
    """Write the annotations of all frames, and those of each set."""
    keypoints: dict[str, list[str]] = {}
    for point in plan.keypoints:
        names = keypoints.setdefault(plan.categories[point.body], [])
        if point.name not in names:
            names.append(point.name)
    frames_by_file = {_COCO: frames}
    # Drawn once, not for each frame.
    validation = plan.validation
    if validation:
        for is_validation, file in _COCO_SETS.items():
            frames_by_file[file] = [
                frame
                for frame in frames
                if (frame["variation"] in validation) == is_validation
            ]
    for file, frames_of_set in frames_by_file.items():
        annotations = coco(
            frames_of_set,
            categories=list(dict.fromkeys(plan.categories)),
            description=description,
            keypoints=keypoints,
        )
        write_json(folder / file, annotations)


def _write_variations(
    console: Console, plan: DatasetPlan, folder: Path, workers: int
) -> None:
    """Write the missing frames of all variations, each in one of several processes."""
    missing = [
        number
        for number, variation in enumerate(plan.variations)
        if len(list((folder / _LABELS).glob(f"{variation.name}_*.json")))
        < plan.frames_of(variation)
    ]
    workers = min(workers, len(missing))
    if workers <= 1:
        for number in missing:
            _write_variation(console, plan=plan, number=number, folder=folder)
        return
    # A process that is forked would share the locks of JAX's threads.
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin_worker,
        initargs=(max(1, (os.cpu_count() or 1) // workers),),
    )
    with pool, terminal_progress(console) as progress:
        progress.stage("simulating and drawing", len(missing))
        runs = {
            pool.submit(_write_in_worker, plan, number, folder): number
            for number in missing
        }
        try:
            for run in as_completed(runs):
                run.result()
                variation = plan.variations[runs[run]]
                progress.line(f"{variation.name}: {_in_words(variation.changes)}")
                progress.advance()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin_worker(threads: int) -> None:
    # Before JAX starts: its pool would have a thread for each core in each process.
    os.environ["NPROC"] = str(threads)
    importlib.import_module("jaxthermo.compilation_cache").cache_compilations()


def _write_in_worker(plan: DatasetPlan, number: int, folder: Path) -> None:
    _write_variation(Console(quiet=True), plan=plan, number=number, folder=folder)


def _write_variation(
    console: Console, plan: DatasetPlan, number: int, folder: Path
) -> None:
    variation = plan.variations[number]
    total = plan.frames_of(variation)
    print_line(console, f"{variation.name}: {_in_words(variation.changes)}")
    with precision(variation.config.dtype):
        run_folder = prepare_folder(folder / "runs" / variation.name)
        stored = _stored(console, variation.config, run_folder)
        with terminal_progress(console) as progress:
            progress.stage("drawing frames", total)
            for view in range(len(plan.views)):
                frames = _write_view(
                    plan, number=number, view=view, stored=stored, folder=folder
                )
                for _ in frames:
                    progress.advance()


def _stored(console: Console, config: SceneConfig, run_folder: Path) -> StoredSolution:
    """The run of a variation: read, continued or simulated."""
    if (run_folder / SOLUTION_FILE).is_file():
        return load_run(run_folder)
    write_text(run_folder / CONFIG, to_yaml(config))
    with status(console, "building the scene"):
        scene = config.build()
        plan = plan_of(config, scene)
    result, _ = run_plan(console, config=config, plan=plan, out=run_folder)
    if result.result != RESULTS.successful:
        raise InputError(f"{run_folder}: {RESULTS[result.result]}")
    stored = result.stored()
    stored.save(run_folder)
    (run_folder / CHECKPOINT).unlink(missing_ok=True)
    return stored


def _write_view(
    plan: DatasetPlan, number: int, view: int, stored: StoredSolution, folder: Path
):
    """Write the frames of a variation in a view; yields after each of them."""
    config = plan.scene(number, view)
    variation = plan.variations[number]
    names = {
        time.index: f"{variation.name}_c{view:04d}_{time.name}"
        for time in chosen_frames(config, stored.times)
    }
    if all((folder / _LABELS / f"{name}.json").is_file() for name in names.values()):
        for _ in names:
            yield
        return
    camera = FrameCamera(config, stored.surfaces, config.build_terms())
    matrices = camera_matrices(camera.camera)
    draw = camera.detector(stored)
    for k, name in names.items():
        image = coarsen(draw(k), camera.samples)
        labels = _write_images(
            plan, image=image, folder=folder, name=name, config=config
        )
        labels["keypoints"] = keypoint_labels(
            plan.keypoints,
            surfaces=stored.surfaces,
            time=float(image.time),
            camera=camera.camera,
            object_id=np.asarray(image.object_id),
            depth=np.asarray(image.depth, float),
        )
        write_json(
            folder / _LABELS / f"{name}.json",
            {
                "file": f"images/{name}.png",
                "variation": variation.name,
                "changes": variation.changes,
                "view": view,
                "time_s": float(image.time),
                "camera": matrices,
                **labels,
            },
        )
        yield


def _write_images(
    plan: DatasetPlan, image: Image, folder: Path, name: str, config: SceneConfig
) -> FrameLabels:
    """Write the files of a frame; returns its labels."""
    kelvin = np.asarray(image.apparent_temperature, float)
    body = np.asarray(image.object_id)
    depth = np.asarray(image.depth, float)
    low, high = _levels(plan, kelvin)

    def file(channel: str) -> Path:
        return folder / channel / f"{name}.png"

    write_grey(file("images"), centikelvin(kelvin))
    write_grey(file("images_8bit"), grey_levels(kelvin, low, high))
    write_grey(file("masks"), _numbered(body))
    # In millimetres, 0 where there is no body, as depth cameras do.
    millimetres = np.rint(np.where(body >= 0, depth, 0) * 1000)
    write_grey(file("depth"), np.clip(millimetres, 0, 65535).astype(np.uint16))
    if image.part_id is not None:
        prepare_folder(folder / "parts")
        write_grey(file("parts"), _numbered(np.asarray(image.part_id)))
    exact = folder / "radiometric" / f"{name}.exr"
    write_exr(exact, image, {"config": to_yaml(config)})
    labelled = [
        InstanceLabels(
            body=instance.number,
            category=plan.categories[instance.number],
            box=list(instance.box),
            area=instance.area,
            is_cut=instance.is_cut,
            segmentation=run_lengths(instance.mask),
            parts=_parts(image, instance.number),
        )
        for instance in instances(body)
    ]
    height, width = kelvin.shape
    return FrameLabels(
        width=width,
        height=height,
        low_K=low,
        high_K=high,
        saturated_pixels=saturated_pixels(kelvin),
        instances=labelled,
        keypoints=[],
    )


def _levels(plan: DatasetPlan, kelvin: Float[np.ndarray, "h w"]) -> tuple[float, float]:
    """Temperatures of black and white of a frame [K]."""
    percentiles = np.percentile(kelvin, [_DARK, _BRIGHT]).tolist()
    low = percentiles[0] if plan.config.low is None else plan.config.low
    high = percentiles[1] if plan.config.high is None else plan.config.high
    return low, max(high, low + 0.1)


def _numbered(number: np.ndarray) -> np.ndarray:
    """Numbers from 1 as pixels, 0 in the background."""
    dtype = np.uint8 if number.max(initial=0) < _BODIES else np.uint16
    return (number + 1).astype(dtype)


def _parts(image: Image, body: int) -> list[PartLabels]:
    """Visible parts of a body, with their boxes."""
    if image.part_id is None or not image.part_names[body]:
        return []
    part_numbers = np.where(
        np.asarray(image.object_id) == body, np.asarray(image.part_id), -1
    )
    names = image.part_names[body]
    return [
        PartLabels(
            part=part.number,
            name=names[part.number],
            box=list(part.box),
            area=part.area,
        )
        for part in instances(part_numbers)
    ]
