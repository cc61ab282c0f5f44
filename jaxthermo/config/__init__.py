"""YAML to scenes: the only place of pydantic, yaml and pint."""
