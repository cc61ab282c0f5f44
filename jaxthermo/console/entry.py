"""Entry of the command lines: a user's mistake is one line, never a traceback."""

import atexit
import functools
import gc
import importlib
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, ParamSpec

from cyclopts import App, CycloptsError, Parameter

from ..atomic import disk_error
from ..errors import InputError
from .interrupt import INTERRUPTED, safe_interrupt
from .terminal import quiet_output


Flag = Annotated[bool, Parameter(negative="")]
"""An option without a value; help hides its negative."""
Overrides = Annotated[
    tuple[str, ...],
    Parameter(name="--set", negative="", metavar="KEY=VALUE", show_default=False),
]
Animate = Annotated[
    tuple[Literal["apng", "gif", "mp4"], ...] | None,
    Parameter(negative="", consume_multiple=(0, 1), show_default=False),
]
"""Kind of an animation; the option alone means the first kind."""
_QUIET = inspect.Parameter(
    "quiet",
    kind=inspect.Parameter.KEYWORD_ONLY,
    default=False,
    annotation=Annotated[
        bool, Parameter(negative="", help="Print nothing but warnings and mistakes.")
    ],
)
_P = ParamSpec("_P")
_BROKEN_PIPE = 141
"""Exit status where nobody reads the output any more, as that of SIGPIPE in shells."""


def compiles(command: Callable[_P, None]) -> Callable[_P, None]:
    """Decorator of commands that take long: they may be `--quiet`.

    The programs that they compile are stored, and later commands use them again.
    """

    @functools.wraps(command)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> None:
        is_quiet = bool(kwargs.pop(_QUIET.name, False))
        # Before jaxlib reads it: where XLA rejects a stored program, it would print
        # lines about wrong machine types, and the program is compiled again.
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
        # By name: it imports JAX, which help and tables do not need.
        cache = importlib.import_module("jaxthermo.compilation_cache")
        cache.cache_compilations()
        with quiet_output(is_quiet):
            command(*args, **kwargs)

    signature = inspect.signature(command)
    parameters = [*signature.parameters.values(), _QUIET]
    inspected: Any = run
    inspected.__signature__ = signature.replace(parameters=parameters)
    return run


def make_app(name: str, help: str, version: str | None = None) -> App:
    """A command line without commands, with `--install-completion` for shells."""
    # `run_app` reports where a run was interrupted.
    app = App(name=name, help=help, version=version, suppress_keyboard_interrupt=False)
    app.register_install_completion_command()
    return app


def run_app(app: App, name: str, arguments: Sequence[str] | None = None) -> None:
    """Run one command and exit.

    The status is 0 on success, 2 for a mistake of the user or a machine that lacks
    something, in one line, 130 after Ctrl-C, and 141 where the output is read no more.

    Args:
        app: the commands.
        name: name of the program, before every message.
        arguments: of the command; those of the process if None.
    """
    # Packages and traces make many objects that live as long as the process: searching
    # them for garbage, often and once more at the end, would slow a short command down.
    gc.set_threshold(20_000, 20, 20)
    atexit.register(gc.freeze)
    warnings.showwarning = functools.partial(_show_warning, name, warnings.showwarning)
    try:
        tokens = list(sys.argv[1:] if arguments is None else arguments)
        with safe_interrupt(name):
            app(tokens, exit_on_error=False, print_error=False)
        sys.stdout.flush()
    except (InputError, CycloptsError) as error:
        sys.exit(_refuse(name, error))
    except SystemExit as stop:
        # Rich ends a process that writes to a broken pipe with a status of its own.
        if not isinstance(stop.__context__, BrokenPipeError):
            raise
        sys.exit(_BROKEN_PIPE)
    except KeyboardInterrupt as stop:
        sys.stderr.write(f"{name}: {str(stop) or 'interrupted'}\n")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        _discard_output()
        sys.exit(_BROKEN_PIPE)
    except Exception as error:
        line = _fault_of_machine(error)
        if line is None:
            raise
        if isinstance(error, OSError) and error.filename is None:
            _discard_output()
        sys.exit(_refuse(name, InputError(line)))
    sys.exit(0)


def _fault_of_machine(error: Exception) -> str | None:
    """A fault of the machine in one line; None for a defect of this package."""
    text = str(error)
    if isinstance(error, OSError):
        reason = error.strerror or text
        # Where a file is first touched: a name that is too long, no access to a folder.
        if error.filename is not None:
            path = error.filename
            return f"{path}: {reason.lower()}; check the path and its permissions"
        # Errors of files are an `InputError`: this one is of standard output.
        if disk_error(error) is not None:
            return f"cannot write the output: {reason}"
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in text:
        return (
            f"out of memory ({_first_line(text)}): use a coarser pitch, or a machine "
            "with more memory"
        )
    fault = _fault_of_devices()
    if fault is None:
        return None
    platforms = os.environ.get("JAX_PLATFORMS", "")
    return (
        f"JAX_PLATFORMS={platforms}: JAX has no such device here{fault}; unset it, or "
        "set it to cpu"
    )


def _fault_of_devices() -> str | None:
    """The error of JAX without devices, after a colon if it has a text; None if none.

    JAX raises it where it is first used, as one of several plain exceptions.
    """
    jax = sys.modules.get("jax")
    if jax is None:
        return None
    try:
        jax.devices()
    except Exception as error:
        line = _first_line(str(error))
        return f": {line}" if line else ""
    return None


def _first_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[0][:200].rstrip(".:; ") if lines else ""


def _show_warning(
    name: str,
    show: Callable[..., None],
    message: Warning | str,
    category: type[Warning],
    *position: object,
    **options: object,
) -> None:
    """Write a warning to the user as one line; those to programmers as Python does."""
    if category is UserWarning:
        sys.stderr.write(f"{name}: warning: {' '.join(str(message).split())}\n")
    else:
        show(message, category, *position, **options)


def _discard_output() -> None:
    # The rest of the buffer must not raise again at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse(name: str, error: Exception) -> int:
    text = str(error)
    if isinstance(error, CycloptsError):
        # Cyclopts breaks its messages into lines, and here a line is a mistake.
        text = f"{' '.join(text.split())} Try `{name} --help`."
    # A config may hold several mistakes: a line for each.
    for line in text.splitlines():
        if line.strip():
            sys.stderr.write(f"{name}: {' '.join(line.split())}\n")
    return 2
