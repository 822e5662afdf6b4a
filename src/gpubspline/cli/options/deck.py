"""What a deck carries beside its mesh: format, units, load case, means of the modulus."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.cli.options.solve import LOAD
from gpubspline.errors import InputError


def complete_load(incomplete: str) -> list[str]:
    """Names of the load cases that come with the package and begin as what is typed."""
    from gpubspline.analysis.load_case import load_cases

    return [name for name in load_cases() if name.startswith(incomplete)]


def complete_format(incomplete: str) -> list[str]:
    """Names of the formats that begin as what is typed."""
    from gpubspline.export import formats

    return [name for name in formats() if name.startswith(incomplete)]


@dataclass
class DeckOptions:
    """What a deck carries beside its mesh."""

    format: Annotated[
        str | None,
        option("Deck", "format (default: by the extension)", "--format", metavar="NAME", complete=complete_format),
    ] = None
    units: Annotated[str, option("Deck", "system of units", metavar="mm-N-MPa|m-N-Pa")] = "mm-N-MPa"
    load: Annotated[
        str | None,
        option(
            "Deck",
            LOAD,
            metavar="NAME|FILE.toml",
            complete=complete_load,
        ),
    ] = None
    modulus_bins: Annotated[
        int | None,
        option("Deck", "N element sets by modulus (default: a modulus by node where the format has one)", metavar="N"),
    ] = None
    nodal_modulus: Annotated[bool, option("Deck", "refuse a format without a modulus by node", "--nodal-modulus")] = (
        False
    )

    def check(self, output: Path) -> None:
        """Raise InputError where the format does not hold what is asked for, before any work."""
        from gpubspline.analysis.load_case import load_case
        from gpubspline.export import find_format
        from gpubspline.export.units import find_units

        form = find_format(output, self.format)
        asked = {"binned": self.modulus_bins is not None, "nodal": self.nodal_modulus, "loads": self.load is not None}
        if self.modulus_bins is not None and self.modulus_bins < 1:
            raise InputError(f"expected --modulus-bins of 1 or more, got {self.modulus_bins}")
        form.check_asked(self.format or output.suffix.lower(), **asked)
        find_units(self.units)
        if self.load is not None:
            load_case(self.load)

    def check_orthotropy(self, output: Path) -> None:
        """Raise InputError where the format cannot carry orthotropic elements, before any work."""
        from gpubspline.export import find_format

        find_format(output, self.format).check_orthotropic(self.format or output.suffix.lower())

    def check_material(self, output: Path) -> None:
        """Raise InputError where a mesh without material is asked for what it has not, before any work."""
        from gpubspline.export import find_format

        find_format(output, self.format).check_material(self.format or output.suffix.lower())
        if self.modulus_bins is not None or self.nodal_modulus:
            raise InputError("expected --ct for a modulus by bins or by node, got a surface without a CT")

    @property
    def inputs(self) -> list[Path]:
        """The file of the load case, if it is one."""
        return [Path(self.load)] if self.load else []

    @property
    def plain(self) -> bool:
        """Whether nothing is asked for but the mesh."""
        return self == DeckOptions()

    def how(self) -> dict[str, Any]:
        """Keywords of ``export.write``."""
        return {
            "format": self.format,
            "units": self.units,
            "load": self.load,
            "modulus_bins": self.modulus_bins,
            "nodal_modulus": self.nodal_modulus,
        }
