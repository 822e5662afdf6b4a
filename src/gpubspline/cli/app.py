"""The application that the commands join."""

from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

LOOK, MAKE, JUDGE, SOLVE, MANY, KNOW = (
    "Look at what there is",
    "Make a mesh",
    "Judge it and make it better",
    "Solve it, or hand it over",
    "Do it for many",
    "Know what it rests on, and try it out",
)
"""Headings of the commands in ``gpubspline --help``, in the order of the work."""

ON_THE_WAY = ("warp-lang", "pyopencl", "pocl-binary-distribution", "numpy")
"""Packages whose versions may decide what a kernel does: told by ``--version``."""


def _without_types(found: list[Any]) -> list[Any]:
    """Keep ``<bool>`` and ``<list[Path]>`` out of the help: a flag takes nothing, an argument says what it is."""
    for each in found:
        if each.param_type_name == "argument" or (each.is_flag and each.metavar is None):
            each.display_type_rich = lambda ctx: None
    return found


class _Command(TyperCommand):
    def get_params(self, ctx: Any) -> Any:
        return _without_types(super().get_params(ctx))


class _Group(TyperGroup):
    def get_params(self, ctx: Any) -> Any:
        return _without_types(super().get_params(ctx))


def _foot(examples: tuple[str, ...]) -> str:
    return "\n".join(["Examples:", *(f"gpubspline {each}" for each in examples)])


app = typer.Typer(
    name="gpubspline",
    cls=_Group,
    help="CT in, all-hexahedral finite element model out: every node carries x, y, z, HU, density, E and nu.",
    epilog=_foot(("demo", "info ct.nii.gz", "COMMAND --help")),
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def command(heading: str, *examples: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Join a function to the application, under a heading of the help.

    ``examples`` stand at the foot of its own help: words after ``gpubspline``, of at most 66 characters each.
    """
    return app.command(cls=_Command, rich_help_panel=heading, epilog=_foot(examples))


USAGE_ERROR: Any = typer.BadParameter.__mro__[2]
"""Click's ``ClickException``, which Typer brings along in a copy of its own or not, by its version."""


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo("\n".join([f"gpubspline {version('gpubspline')}", *filter(None, map(_version, ON_THE_WAY))]))
        raise typer.Exit


def _version(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"{package}, not installed" if package != "pocl-binary-distribution" else ""


_VERSION = typer.Option(
    "--version", help="Show the versions of this and of what runs its kernels.", callback=_tell_version, is_eager=True
)


@app.callback()
def _of_all(told: Annotated[bool, _VERSION] = False) -> None:
    pass
