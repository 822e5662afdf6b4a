"""The command line as a process: what is wrong with the input is one line on stderr and an exit status."""

import logging
import signal
import sys
import warnings
from pathlib import Path
from typing import NoReturn

import typer

from gpubspline.cli import INTERRUPTED, warned
from gpubspline.cli import commands as commands
from gpubspline.cli.app import USAGE_ERROR as USAGE_ERROR
from gpubspline.cli.app import app as app
from gpubspline.errors import GpubsplineError, GpubsplineWarning


def run() -> None:
    """Run the command line.

    Whatever is wrong with the input is one line on stderr and exit status 2; so is an interrupt, with 130, and what
    else ends a process, with 128 and the number of its signal.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # that it cannot keep a list of fonts is not for the user
    warnings.simplefilter("ignore")
    warnings.simplefilter("always", GpubsplineWarning)
    warnings.showwarning = warned.warn
    warned.forget()
    signal.signal(signal.SIGTERM, _terminate)
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:  # nohup has it ignored
        signal.signal(signal.SIGHUP, _terminate)
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except USAGE_ERROR as error:
        _fail(error.format_message() + _hint())
    except (typer.Abort, KeyboardInterrupt):
        _fail("interrupted", INTERRUPTED)
    except _Terminated as end:
        _fail("terminated", int(end.code or 0))
    except ImportError as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # in the middle of loading a compiled module
            _fail("interrupted", INTERRUPTED)
        if not isinstance(error, ModuleNotFoundError) or (error.name or "gpubspline").startswith("gpubspline"):
            raise
        _fail(f"expected the package {error.name} to be installed: pip install gpubspline brings what it needs")
    except GpubsplineError as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"cannot use {error.filename}: {error.strerror}" if error.filename else str(error))
    except MemoryError as error:
        where = f" ({error})" if str(error) else ""
        _fail(f"not enough memory{where}: ask for fewer nodes, or crop the CT with --box")
    if status == INTERRUPTED:  # which Typer makes of an interrupt, without a word
        _fail("interrupted", INTERRUPTED)
    raise SystemExit(status if isinstance(status, int) else 0)


class _Terminated(SystemExit):
    """Another process ended this one, or its terminal was closed."""


def _terminate(number: int, _: object) -> NoReturn:
    """End as by an error, so that no half of a file stays."""
    raise _Terminated(128 + number)


def _hint() -> str:
    """What to do about a file whose name is taken for an option."""
    found = next((word for word in sys.argv[1:] if word.startswith("-") and Path(word).exists()), None)
    return "" if found is None else f" The file {found} can be given as ./{found}"


def _fail(message: str, status: int = 2) -> NoReturn:
    typer.echo(f"gpubspline: error: {warned.one_line(message)}", err=True)
    raise SystemExit(status)
