"""A case: one choice of structure, voxels and solver under one load.

Cases whose programs have arrays of the same shapes run together, see `evaluate`.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from jaxthermo.config.loader import config_hash, load_config, resolved
from jaxthermo.config.schema.scene import SceneConfig

from ..config.schema import AbsoluteReference
from ..problem.reference import program_hash, reference_key


@dataclass(frozen=True)
class Case:
    """A scene with the changes of a choice and of a load."""

    config: SceneConfig
    names: tuple[tuple[str, str], ...]
    """The choice: the label of its value on each axis."""
    load: str
    truth: AbsoluteReference
    set: tuple[tuple[str, Any], ...] = ()
    """Changes of the choice by dotted key."""

    @cached_property
    def id(self) -> str:
        """Hash of the resolved scene, its names, the reference and the program."""
        # A changed program gives other errors, and another case; two choices that
        # come to the same scene are two cases.
        scene = config_hash(_run_part(self.config))
        names = json.dumps([self.names, self.load])
        truth = self.truth.model_dump_json()
        text = " ".join((scene, names, truth, program_hash()))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @cached_property
    def truth_key(self) -> str:
        """Hash of the reference: equal for cases with a common reference."""
        return reference_key(self.config, self.truth)

    @property
    def shares_voxels(self) -> bool:
        """True if the reference has the same voxels: their error is in both."""
        reference = self.truth
        key = "pitch" if reference.voxels_high is None else "voxels_high"
        # So many voxels along z are of another size in another body.
        single = key == "pitch" or len(self.config.bodies) == 1
        return single and all(
            getattr(body, key) == getattr(reference, key)
            and (body.surface_cells or "crossings") == reference.surface_cells
            for body in self.config.bodies
        )

    @cached_property
    def shape_key(self) -> str:
        """Equal text for cases with arrays of the same shapes.

        Cases with the same text may still differ in shape: `evaluate_group` looks.
        """
        plain = resolved(_run_part(self.config))
        for body in plain["bodies"]:
            body["structure"].pop("weights", None)
            for key in ("material", "temperature", "coatings", "regions"):
                body[key] = _kinds(body.get(key))
        plain["terms"] = _kinds(plain["terms"])
        return json.dumps(plain, sort_keys=True, default=str)

    @property
    def head(self) -> dict[str, Any]:
        """First fields of the case's row."""
        return {
            "id": self.id,
            "choice": dict(self.names),
            "load": self.load,
            "set": dict(self.set),
        }


def _run_part(config: SceneConfig) -> SceneConfig:
    """Config without what has no effect on temperatures."""
    fields = type(config).model_fields
    defaults = {key: fields[key].default for key in ("camera", "image", "truth")}
    return config.model_copy(update={"name": None, **defaults})


def _kinds(value: Any) -> Any:
    """Plain values with every number replaced: the rest decides shapes."""
    if isinstance(value, Mapping):
        return {key: _kinds(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_kinds(item) for item in value]
    return value if isinstance(value, str | bool | type(None)) else "number"


def changed_config(
    path: Path, *changes: Mapping[str, Any], find_meshes: bool = True
) -> SceneConfig:
    """Scene in a file with changes by dotted key, later ones over earlier ones.

    Raises:
        InputError: for a change that the scene cannot have.
    """
    texts = [
        f"{key}={json.dumps(value)}"
        for change in changes
        for key, value in change.items()
    ]
    return load_config(path, texts, find_meshes=find_meshes)
