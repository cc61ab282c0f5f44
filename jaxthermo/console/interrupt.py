"""Ctrl-C as an exception, but never within an import, and never as a traceback.

Compiled packages that are interrupted while they initialize crash, or raise an error of
their own that hides the interrupt. Programs import this module first: from then on an
interrupt that reaches the interpreter is one line.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType, TracebackType


INTERRUPTED = 130
"""Exit status of a command that Ctrl-C ends, as shells have it."""


_show_exception = sys.excepthook


def _show(
    category: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if category is KeyboardInterrupt:
        sys.stderr.write(f"{PurePath(sys.argv[0]).stem}: interrupted\n")
    else:
        _show_exception(category, error, trace)


sys.excepthook = _show


@contextmanager
def safe_interrupt(name: str) -> Iterator[None]:
    """End the process at once for a Ctrl-C within an import; raise it elsewhere.

    Args:
        name: name of the program, before the message.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        del number
        if _is_importing(frame):
            os.write(sys.stderr.fileno(), f"{name}: interrupted\n".encode())
            os._exit(INTERRUPTED)
        raise KeyboardInterrupt

    # Another handler, or a background process without interrupts, stays as it is.
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
