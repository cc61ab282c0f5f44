"""Memory known before it is taken."""

import os

from .errors import InputError


def available_bytes() -> int:
    """Memory this process may still take: the host's free pages."""
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") + _cached_bytes()


def _cached_bytes() -> int:
    """Page cache, which the kernel hands back when asked (Linux; else 0)."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            table = dict(line.split(":", 1) for line in lines)
    except OSError:
        return 0
    return int(table.get("Cached", "0 kB").split()[0]) * 1024


def readable_bytes(count: float | int) -> str:
    """A number of bytes for people, e.g. "3.2 GiB"."""
    for unit in ("B", "KiB", "MiB", "GiB", "TiB"):
        if count < 1024 or unit == "TiB":
            break
        count /= 1024
    return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"


def require_memory(needed: int, what: str, remedy: str) -> None:
    """Refuse work that would not fit, before anything is allocated.

    Raises:
        InputError: if more than 80 % of the available memory would be needed.
    """
    available = available_bytes()
    if needed > 0.8 * available:
        raise InputError(
            f"{what} needs about {readable_bytes(needed)} of memory and "
            f"{readable_bytes(available)} is free: {remedy}"
        )
