"""Packages of the extras: which one is missing, and the commands that install it."""

import importlib.util

from .errors import InputError


def install_commands(extra: str) -> str:
    """Commands of which each installs an extra, in the folder of the source."""
    return (
        f"`make env EXTRAS={extra}` or `pip install '.[{extra}]'` in the folder of "
        "jaxthermo"
    )


def is_installed(package: str) -> bool:
    """True if a package can be imported, by its name as a module."""
    return importlib.util.find_spec(package) is not None


def missing_package(
    purpose: str, package: str, extra: str, otherwise: str = ""
) -> InputError:
    """Refusal of what needs a package that is not installed.

    Args:
        purpose: what needs it, with its verb: "an animation as MP4 needs".
        package: its name as a module.
        extra: the extra that it belongs to.
        otherwise: what works without it: "choose gif".
    """
    alternative = f", or {otherwise}" if otherwise else ""
    return InputError(
        f"{purpose} the package {package}: run {install_commands(extra)}{alternative}"
    )


def require_extra(purpose: str, package: str, extra: str, otherwise: str = "") -> None:
    """Refuse what needs a package that is not installed; arguments as above.

    Raises:
        InputError: with the commands that install it.
    """
    if not is_installed(package):
        raise missing_package(purpose, package, extra, otherwise)
