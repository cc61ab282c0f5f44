"""Entry of the command lines: a user's mistake is one line, never a traceback."""

import atexit
import functools
import gc
import importlib
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, Literal, ParamSpec

from cyclopts import App, CycloptsError, Parameter

from ..atomic import disk_error
from ..errors import InputError


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
_P = ParamSpec("_P")


def compiles(command: Callable[_P, None]) -> Callable[_P, None]:
    """Decorator of commands that compile programs; later commands use them again."""

    @functools.wraps(command)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> None:
        # Before jaxlib reads it: where XLA rejects a stored program, it would print
        # lines about wrong machine types, and the program is compiled again.
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
        # By name: it imports JAX, which help and tables do not need.
        cache = importlib.import_module("jaxthermo.compilation_cache")
        cache.cache_compilations()
        command(*args, **kwargs)

    return run


def make_app(name: str, help: str, version: str | None = None) -> App:
    """A command line without commands, with `--install-completion` for shells."""
    # `run_app` reports where a run was interrupted.
    app = App(name=name, help=help, version=version, suppress_keyboard_interrupt=False)
    app.register_install_completion_command()
    return app


def run_app(app: App, name: str, arguments: Sequence[str] | None = None) -> None:
    """Run one command and exit: status 0 on success, 2 for a mistake of the user.

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
        app(tokens, exit_on_error=False, print_error=False)
        sys.stdout.flush()
    except (InputError, CycloptsError) as error:
        sys.exit(_refuse(name, error))
    except KeyboardInterrupt as stop:
        sys.stderr.write(f"{name}: {str(stop) or 'interrupted'}\n")
        sys.exit(130)
    except BrokenPipeError:
        _discard_output()
        sys.exit(141)
    except OSError as error:
        # Errors of files are an `InputError`: this one is of standard output.
        if disk_error(error) is None:
            raise
        _discard_output()
        sys.stderr.write(f"{name}: cannot write the output: {error.strerror}\n")
        sys.exit(2)
    sys.exit(0)


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
