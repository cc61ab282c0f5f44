"""The config of a dataset, read and checked."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from ..errors import InputError
from .loader import mesh_folders, with_overrides
from .messages import described, in_file
from .schema.dataset import DatasetConfig
from .strict_yaml import read_yaml
from .types.files import FOLDERS
from .types.model import Location


_NEEDS = "a dataset needs `scene`, and `views` or `orbit`"


def load_dataset(path: str | Path, overrides: Sequence[str] = ()) -> DatasetConfig:
    """The config in a YAML file; the scene's file is searched for in its folder.

    Raises:
        InputError: one line for each mistake.
    """
    path = Path(path)
    data, _ = with_overrides(read_yaml(path, _NEEDS), overrides)
    context = {FOLDERS: mesh_folders(path.parent)}

    def source(location: Location) -> str:
        return in_file(path, location)

    try:
        return DatasetConfig.model_validate(data, context=context)
    except ValidationError as error:
        raise InputError(described(error, source)) from error
