"""The command line as a process: what is wrong with the input is one line on stderr and an exit status."""

import sys
import warnings
from typing import NoReturn

import typer

from gpubspline.cli import commands as commands
from gpubspline.cli import warned
from gpubspline.cli.app import USAGE_ERROR, app
from gpubspline.errors import GpubsplineError, GpubsplineWarning


def main() -> None:
    """Run the command line; whatever is wrong with the input is one line on stderr and exit status 2."""
    warnings.simplefilter("ignore")
    warnings.simplefilter("always", GpubsplineWarning)
    warnings.showwarning = warned.warn
    warned.forget()
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except USAGE_ERROR as error:
        _fail(error.format_message())
    except typer.Abort:
        _fail("interrupted", 130)
    except GpubsplineError as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"cannot use {error.filename}: {error.strerror}" if error.filename else str(error))
    except MemoryError:
        _fail("not enough memory: ask for fewer nodes, or crop the CT with --box")
    raise SystemExit(status if isinstance(status, int) else 0)


def _fail(message: str, status: int = 2) -> NoReturn:
    typer.echo(f"gpubspline: error: {warned.one_line(message)}", err=True)
    raise SystemExit(status)
