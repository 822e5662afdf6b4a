"""What a file format is and what it holds: declared by each format's module, asked by ``write``."""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gpubspline.errors import InputError
from gpubspline.mesh.elements import MESHABLE

if TYPE_CHECKING:
    from gpubspline.export.deck import Deck


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    name: as ``write`` and ``--format`` take it.
    extensions: that it is found by, the first one its own.
    element_types: that it holds.
    write: writes a deck, whole or not at all.
    nodal: how it holds a modulus by node: ``"table"``, along a field that plays the temperature, ``"field"``, or not.
    most_rows: of that table, None for any number.
    binned: whether it has sections, for element sets by modulus.
    orthotropic: whether its sections hold orthotropic material and an axis for each element.
    loads: whether it holds a load case.
    sets: whether it holds node and element sets.
    longest_name: characters of a set's name, None for any number.
    fields, cell_fields: whether it holds nodal and element fields of any name.
    material: whether it holds no mesh without a modulus.
    needs: a package that it wants, which does not come with this one.
    readable: whether ``read_mesh`` reads it back.
    """

    name: str
    extensions: tuple[str, ...]
    element_types: tuple[str, ...]
    write: Callable[["Deck", Path], None]
    nodal: str = ""
    most_rows: int | None = None
    binned: bool = False
    orthotropic: bool = False
    loads: bool = False
    sets: bool = False
    longest_name: int | None = None
    fields: bool = False
    cell_fields: bool = False
    material: bool = False
    needs: str = ""
    readable: bool = True

    def check_needs(self, known: str) -> None:
        """Raise InputError, for a format ``known`` by this, where the package that it needs is not installed."""
        if self.needs and importlib.util.find_spec(self.needs) is None:
            raise InputError(
                f"expected {self.needs}, which {known} files need, to be installed: pip install {self.needs}"
            )

    def check_elements(self, known: str, element_type: str) -> None:
        """Raise InputError where the format, ``known`` by this, does not hold the elements."""
        if element_type not in self.element_types:
            held = ", ".join(self.element_types)
            other = "; .vtu holds them" if element_type in MESHABLE and ".vtu" not in self.extensions else ""
            raise InputError(f"expected elements of {held} for {known}, got {element_type}{other}")

    def check_material(self, known: str) -> None:
        """Raise InputError where the format, ``known`` by this, holds no mesh without material."""
        if self.material:
            raise InputError(f"expected material for {known}, which holds no mesh without, got a surface without a CT")

    def check_orthotropic(self, known: str) -> None:
        """Raise InputError where the format, ``known`` by this, holds no orthotropic elements."""
        if not (self.orthotropic or self.cell_fields):
            raise InputError(
                f"expected a format that holds orthotropic elements, such as .inp, .feb or .vtu, got {known}"
            )

    def check_asked(self, known: str, *, binned: bool, nodal: bool, loads: bool) -> None:
        """Raise InputError where the format, ``known`` by this, does not hold what is asked for."""
        if binned and not self.binned:
            raise InputError(f"expected modulus bins with a deck, which has sections, got {known}, which has none")
        if nodal and binned:
            raise InputError("expected a modulus by node or modulus bins, got both")
        if nodal and not self.nodal:
            raise InputError(f"expected a format that holds a modulus by node, got {known}, which does not")
        if loads and not self.loads:
            raise InputError(f"expected a format that holds a load case, got {known}, which has no place for it")
