"""Memory of the host: how much is free, and work that does not fit."""

import os

from .errors import InputError


def available_bytes() -> int:
    """Memory of the host that this process can still allocate [bytes]."""
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") + _cached_bytes()


def _cached_bytes() -> int:
    # The kernel frees its page cache on demand. Only Linux tells its size.
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            cached = next((line for line in lines if line.startswith("Cached:")), "")
    except OSError:
        return 0
    return int(cached.split()[1]) * 1024 if cached else 0


def readable_bytes(count: float | int) -> str:
    """Format a number of bytes, e.g. "3.2 GiB"."""
    for unit in ("B", "KiB", "MiB", "GiB", "TiB"):
        if count < 1024 or unit == "TiB":
            break
        count /= 1024
    return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"


def require_memory(needed: int, task: str, remedy: str) -> None:
    """Refuse work that does not fit into memory, before any allocation.

    Raises:
        InputError: if more than 80 % of the available memory would be needed.
    """
    available = available_bytes()
    if needed > 0.8 * available:
        raise InputError(
            f"{task} needs about {readable_bytes(needed)} of memory and "
            f"{readable_bytes(available)} is free: {remedy}"
        )
