"""Names of sets and surfaces that a format takes: letters, digits, underscores, and no longer than it holds."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TypeVar

Kept = TypeVar("Kept")


def named(
    own: Mapping[str, Kept],
    added: Mapping[str, Kept],
    longest: int | None = None,
    held: Collection[str] = (),
) -> dict[str, Kept]:
    """Both, under names that a solver takes, which differ by more than their case.

    Arguments
    ---------
    own: what is named already.
    added: what joins it; one that is called as one of ``own`` gets another name.
    longest: characters of a name, None for any number; what is longer is cut.
    held: names that the deck gives itself; what is called so to the letter is the deck's own, read again.
    """
    taken: dict[str, Kept] = {}
    for name, kept in (*own.items(), *added.items()):
        used = taken.keys() if name in held else (*taken, *held)
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        taken[free(plain if plain[:1].isalpha() else f"set_{plain}", used, longest)] = kept
    return taken


def joined(
    own: Mapping[str, Kept],
    added: Mapping[str, Kept],
    same: Callable[[Kept, Kept], bool],
    longest: int | None = None,
    held: Collection[str] = (),
) -> tuple[dict[str, Kept], dict[str, str]]:
    """Both as of ``named``, and by which name each of ``added`` is found there.

    One that is called as one of ``own`` and is the ``same`` is that one; a region of a load case may be another than
    the side of the mesh of its name.
    """
    fresh = {name: kept for name, kept in added.items() if name not in own or not same(own[name], kept)}
    both = named(own, fresh, longest, held)
    names = {id(kept): name for name, kept in both.items()}
    return both, {name: names[id(fresh[name] if name in fresh else own[name])] for name in added}


def apart(names: Iterable[str], taken: Collection[str], ending: str) -> dict[str, str]:
    """By which name each goes beside those that are taken: with the ending where it is one of them, or one so made."""
    return {name: f"{name}{ending}" if ended(name, taken, ending) else name for name in names}


def ended(name: str, taken: Collection[str], ending: str) -> bool:
    """Whether a name, or what it is before its endings, is taken."""
    return name in taken or (name.endswith(ending) and ended(name.removesuffix(ending), taken, ending))


def free(name: str, taken: Iterable[str], longest: int | None) -> str:
    """Name that differs from those taken by more than its case: itself, or with a number at its end."""
    used, number, found = {other.lower() for other in taken}, 1, name[:longest]
    while found.lower() in used:
        number += 1
        end = f"_{number}"
        found = name[: None if longest is None else longest - len(end)] + end
    return found
