"""Names of sets and surfaces that a format takes: letters, digits, underscores, and no longer than it holds."""

import re
from collections.abc import Iterable, Mapping
from typing import TypeVar

Kept = TypeVar("Kept")


def named(own: Mapping[str, Kept], added: Mapping[str, Kept], longest: int | None = None) -> dict[str, Kept]:
    """Both, under names that a solver takes, which differ by more than their case.

    Arguments
    ---------
    own: what is named already.
    added: what joins it; one that is called by the name of one of ``own`` is that one.
    longest: characters of a name, None for any number; what is longer is cut.
    """
    taken: dict[str, Kept] = {}
    for name, kept in (*own.items(), *((name, kept) for name, kept in added.items() if name not in own)):
        taken[_free(re.sub(r"[^A-Za-z0-9_]", "_", name), taken, longest)] = kept
    return taken


def _free(name: str, taken: Iterable[str], longest: int | None) -> str:
    name = name if name[:1].isalpha() else f"set_{name}"
    used, number, free = {other.lower() for other in taken}, 1, name[:longest]
    while free.lower() in used:
        number += 1
        end = f"_{number}"
        free = name[: None if longest is None else longest - len(end)] + end
    return free
