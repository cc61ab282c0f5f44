"""Pictures of every structure: its frame, and how it differs from the full volume's."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from jaxthermo.image.annotate import write_png
from jaxthermo.image.palette import apply_palette
from jaxthermo.image.ticks import decimals_of, label, nice_ticks, time_label, to_celsius
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.sheet import ColourBar, Tile, sheet

from ..harness.record import Record, Row
from .config import FULL
from .measure import Scenery
from .study import Study


PALETTE = "iron"
WITHIN = 0.995
"""Share of the pixels that a scale spans: a few hot tips must not darken the rest."""

Frame = Float[np.ndarray, "h w"]


def write_pictures(
    study: Study, rows: list[Row], folder: Path, prefix: str = ""
) -> list[Path]:
    """Two sheets of a body: `differences_NAME.png` and `frames_NAME.png`."""
    shown = study.config.picture
    chosen = [row for row in rows if row["load"] == shown.load]
    scene = study.scenery
    expected = scene.frame(study.shown_reference)
    frames = _frames(scene, chosen, study.record)
    where = f"{study.body.name}, sun on {shown.load}, {time_label(shown.time)}"
    name = study.body.name
    sheets = {
        "differences": _difference_sheet(scene, expected, chosen, frames, where),
        "frames": _frame_sheet(scene, expected, chosen, frames, where),
    }
    paths = [folder / f"{prefix}{kind}_{name}.png" for kind in sheets]
    for path, image in zip(paths, sheets.values(), strict=True):
        write_png(path, image)
    return paths


def _frames(scene: Scenery, rows: list[Row], record: Record) -> list[Frame]:
    return [scene.frame(record.arrays_of(row)["surface"]) for row in rows]


def _difference_sheet(
    scene: Scenery, expected: Frame, rows: list[Row], frames: list[Frame], where: str
) -> Image.Image:
    """Structure less full volume [K], on one scale for all."""
    differences = [np.asarray(f - expected, float) for f in frames]
    sizes = np.abs([d[scene.body] for d in differences])
    scale = DifferenceScale(nice_limit(float(np.quantile(sizes, WITHIN))))
    tiles = [
        Tile(scale.picture(d, scene.body), row["label"], _rms(d, scene))
        for d, row in zip(differences, rows, strict=True)
    ]
    bar = difference_bar(
        scale,
        "structure less full volume [K], one scale for all; "
        f"the largest difference is {sizes.max():.2g} K",
    )
    title = f"{where}: difference from the full volume"
    return sheet(tiles, bar, title)


def _frame_sheet(
    scene: Scenery, expected: Frame, rows: list[Row], frames: list[Frame], where: str
) -> Image.Image:
    """Surface temperatures, on the reference's scale."""
    ends = np.quantile(expected[scene.body], [1 - WITHIN, WITHIN])
    low, high = float(ends[0]), float(ends[1])
    tiles = [_frame_tile(scene, expected, "reference", "full volume", (low, high))]
    for row, frame in zip(rows, frames, strict=True):
        if row["label"] == FULL:
            continue  # what the reference shows, but for the step
        note = _rms(np.asarray(frame - expected, float), scene)
        tiles.append(_frame_tile(scene, frame, row["label"], note, (low, high)))
    ticks = nice_ticks(to_celsius(low), to_celsius(high))
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 1
    span = max(high - low, 1e-9)
    line = np.linspace(low, high, 512)[None]
    bar = ColourBar(
        colours=apply_palette(line, low, high, PALETTE)[0],
        ticks=tuple(((t - to_celsius(low)) / span, label(t, decimals)) for t in ticks),
        title="surface temperature [\N{DEGREE SIGN}C], as the reference's pixels but "
        "the coldest and hottest 0.5 %",
    )
    return sheet(tiles, bar, f"{where}: frames")


def _frame_tile(
    scene: Scenery, frame: Frame, name: str, note: str, limits: tuple[float, float]
) -> Tile:
    colours = apply_palette(frame, *limits, PALETTE)
    colours[~scene.body] = BACKGROUND
    return Tile(colours, name, note)


def _rms(difference: Frame, scene: Scenery) -> str:
    return f"RMS {np.sqrt((difference[scene.body] ** 2).mean()):.2g} K"
