"""JSON Schemas of the config files on standard output."""

import sys

from ..config.json_schema import json_schema
from ..config.types.model import Model


def print_schema(model: type[Model]) -> None:
    """Print the JSON Schema of one kind of config file."""
    sys.stdout.write(json_schema(model))
