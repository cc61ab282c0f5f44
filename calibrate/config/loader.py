"""Reading of a calibration's YAML file, and of the scenes that it refers to."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxthermo.archive import file_hash, text_hash
from jaxthermo.config.loader import load_config, load_model, resolved
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.temperatures import ALLOW_EXTREME

from .schema import CalibrationConfig


def load_calibration(
    path: str | Path, overrides: tuple[str, ...] = ()
) -> CalibrationConfig:
    """Read and check a calibration config; each mistake is a line of one `InputError`.

    The scene is searched for beside the file. Overrides, "a.b=c" each, are applied in
    order.
    """
    return load_model(CalibrationConfig, path, overrides)


def changed_config(
    path: Path, *changes: Mapping[str, Any], find_meshes: bool = True
) -> SceneConfig:
    """Scene in a file with changes by dotted key, later ones over earlier ones.

    Raises:
        InputError: for a change that the scene cannot have.
    """
    # As overrides, so that mistakes are reported as those of the command line.
    texts = [
        f"{key}={json.dumps(value)}"
        for change in changes
        for key, value in change.items()
    ]
    return load_config(path, texts, find_meshes=find_meshes)


def scene_config(config: CalibrationConfig, *changes: Mapping[str, Any]) -> SceneConfig:
    """Config of the scene with the changes of all cases, then those given, in order."""
    # One option for both files.
    allowed = {ALLOW_EXTREME: True} if config.allow_extreme_temperatures else {}
    return changed_config(config.scene, allowed, config.set, *changes)


def calibration_hash(config: CalibrationConfig) -> str:
    """Hash of the config and of the scene's file [16 hex digits]."""
    values = resolved(config)
    # The content counts, not the folder, so that a copied calibration is the same.
    values["scene"] = file_hash(Path(config.scene))
    text = json.dumps(values, sort_keys=True)
    return text_hash(text)
