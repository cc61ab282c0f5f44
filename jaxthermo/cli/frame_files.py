"""Files of one frame, those that `image.files` names."""

from pathlib import Path

from ..config.loader import to_yaml
from ..config.schema.scene import SceneConfig
from ..image.files import write_exr, write_png
from ..image.frame_values import covered_fraction
from ..image.raster_files import write_centikelvin, write_csv, write_tiff
from ..image.render import Image, coarsen


_ENDINGS = {"centikelvin": "_centikelvin.png"}
"""Ends of the names of files that are not those of their kind."""


def write_frame_files(
    config: SceneConfig, stem: Path, image: Image, scale: tuple[float, float]
) -> set[Path]:
    """Write a frame as all kinds of files that the config asks for.

    Args:
        config: of the scene.
        stem: path of the files, without the end of their names.
        image: the frame, not coarsened yet.
        scale: ends of the colours [K].

    Returns:
        The files.
    """
    how, written = config.image, set[Path]()
    pixels = coarsen(image, how.samples)
    for kind in how.files:
        path = stem.with_name(stem.name + _ENDINGS.get(kind, f".{kind}"))
        match kind:
            case "exr":
                mask = covered_fraction(image, how.samples)
                write_exr(path, pixels, {"config": to_yaml(config)}, mask)
            case "png":
                options = {"palette": how.palette, "samples": how.samples}
                named = {"quantity": how.quantity, "title": config.name or ""}
                write_png(path, image, *scale, **options, **named)
            case "centikelvin":
                write_centikelvin(path, pixels, how.quantity, saturate=True)
            case "tiff":
                write_tiff(path, pixels, how.quantity, *scale)
            case "csv":
                write_csv(path, pixels, how.quantity, config.name or "")
        written.add(path)
    return written
