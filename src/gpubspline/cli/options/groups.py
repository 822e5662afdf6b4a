"""Groups of options as dataclasses: each option is spelled once and shared by the commands that take it."""

import inspect
from collections.abc import Callable, Collection
from dataclasses import MISSING, fields
from functools import wraps
from typing import Any, get_type_hints

import typer

PANELS = (
    *("Input", "Region", "Mesh", "Spline", "Material", "Load", "Solve", "Picture"),
    *("Output", "Deck", "Run"),
)
"""Panels of the help, in the order in which a person thinks: what, which part, how, and where to."""


def flattened(command: Callable[..., None], without: Collection[str] = ()) -> Callable[..., None]:
    """Let a command take groups of options as dataclasses: Typer sees the fields, the command sees the groups.

    Fields named in ``without`` the command has no use for: they are no options of it and keep their defaults.
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if hasattr(kind, "__dataclass_fields__")}
    own = [p for p in inspect.signature(command).parameters.values() if p.name not in groups]
    parameters, annotations = list(own), {p.name: hints[p.name] for p in own}
    for kind in groups.values():
        kinds = get_type_hints(kind, include_extras=True)
        for field in (each for each in fields(kind) if each.name not in without):
            default = inspect.Parameter.empty if field.default is MISSING else field.default
            parameters.append(inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default))
            annotations[field.name] = kinds[field.name]

    @wraps(command)
    def run(**given: Any) -> None:
        parts = {
            name: kind(**{f.name: given.pop(f.name) for f in fields(kind) if f.name in given})
            for name, kind in groups.items()
        }
        command(**given, **parts)

    keyword = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=annotations[p.name]) for p in parameters]
    keyword.sort(key=_place)
    run.__signature__ = inspect.Signature(keyword)  # type: ignore[attr-defined]
    run.__annotations__ = annotations
    return run


def _place(parameter: inspect.Parameter) -> tuple[int, bool]:
    """Arguments and options without a panel first, then panel by panel; within one ``--output``, then as declared."""
    about = getattr(parameter.annotation, "__metadata__", ())
    panel = next((each.rich_help_panel for each in about if isinstance(each, typer.models.OptionInfo)), None)
    return PANELS.index(panel) if panel in PANELS else -1, parameter.name != "output"


def option(
    panel: str,
    text: str,
    *names: str,
    metavar: str | None = None,
    show_default: bool = True,
    complete: Callable[[str], list[str]] | None = None,
) -> Any:
    """Declare an option in a panel of the help; its name is the field's unless ``names`` say otherwise.

    The shell completes it by ``complete``, or to the words that the metavar lists.
    """
    shown: dict[str, Any] = {"metavar": metavar, "rich_help_panel": panel, "show_default": show_default}
    return typer.Option(*names, help=text, autocompletion=complete or completion(metavar), **shown)


def completion(metavar: str | None) -> Callable[[str], list[str]] | None:
    """Words of a metavar such as ``auto|warp|opencl`` that begin as what is typed; None where it lists none."""
    words = [word for word in (metavar or "").split("|") if word == word.lower()]
    if len(words) < 2:
        return None
    return lambda incomplete: [word for word in words if word.startswith(incomplete)]


def complete_law(incomplete: str) -> list[str]:
    """Names of the registry that begin as what is typed, also after a label."""
    from gpubspline.material.registry import laws

    label, equals, begun = incomplete.rpartition("=")
    return [f"{label}{equals}{name}" for name in laws() if name.startswith(begun)]


def complete_mapping(incomplete: str) -> list[str]:
    """Mappings that begin as what is typed."""
    from gpubspline.material.assign import MAPPINGS

    return [name for name in MAPPINGS if name.startswith(incomplete)]


def complete_element(incomplete: str) -> list[str]:
    """Element types that begin as what is typed."""
    from gpubspline.mesh.elements import ELEMENTS

    return [name for name, kind in ELEMENTS.items() if kind.dimension > 1 and name.startswith(incomplete)]


def complete_device(incomplete: str) -> list[str]:
    """Devices that are present and begin as what is typed."""
    from gpubspline.device import list_devices

    return [name for name, _ in list_devices() if ":" in name and name.startswith(incomplete)]
