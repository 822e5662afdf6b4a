"""How the mesh is sampled, and what its material is."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import complete_law, option
from gpubspline.cli.options.texts import integers
from gpubspline.errors import InputError


@dataclass
class SamplingOptions:
    """How the mesh is sampled, and what its material is."""

    nodes: Annotated[
        str | None, option("Mesh", "samples per direction (default: as control points)", metavar="U,V[,[R,]W]")
    ] = None
    order: Annotated[int, option("Mesh", "1: quad4, hex8; 2: quad8, hex20", metavar="1|2")] = 1
    element: Annotated[str | None, option("Mesh", "element type instead, such as hex27", metavar="TYPE")] = None
    optimize: Annotated[
        bool, option("Mesh", "move nodes for better hexes, those of the surface along it", "--optimize")
    ] = False
    law: Annotated[
        str | None,
        option(
            "Material",
            "see 'gpubspline laws' (default: wirtz-2000)",
            metavar="NAME|FILE.toml",
            complete=complete_law,
        ),
    ] = None
    out_of_range: Annotated[str, option("Material", "HU that the law does not cover", metavar="clamp|floor|error")] = (
        "clamp"
    )
    floor_modulus: Annotated[float | None, option("Material", "modulus of 'floor'", metavar="MPA")] = None
    mapping: Annotated[
        str,
        option(
            "Material",
            "law at nodes or Gauss points (nodal, gauss), of an element's mean HU or its mean (element-hu, element-e)",
            metavar="HOW",
        ),
    ] = "nodal"
    transverse_law: Annotated[
        str | None,
        option("Material", "law across w: orthotropic elements, --law along w", metavar="NAME|FILE.toml"),
    ] = None
    quadrature: Annotated[
        int | None, option("Material", "points per direction of element-* (default: by the voxels)", metavar="N")
    ] = None
    surface_depth: Annotated[
        float | None, option("Material", "read HU near the surface this far inside", metavar="MM")
    ] = None
    calibration: Annotated[
        Path | None, option("Material", "HU to density: line, table, rods or tissues", metavar="FILE.toml")
    ] = None

    @property
    def files(self) -> list[Path]:
        """Files that are read, among them names of laws, which are none."""
        return [Path(name) for name in (self.law, self.transverse_law, self.calibration) if name]

    def check_without_material(self, partial_volume: str | None = None) -> None:
        """Raise InputError where an option of the material is given: there is no CT to take it from."""
        plain, shape = SamplingOptions(), ("nodes", "order", "element", "optimize")
        given = [
            f.name for f in fields(self) if f.name not in shape and getattr(self, f.name) != getattr(plain, f.name)
        ]
        given += ["partial_volume"] if partial_volume is not None else []
        if given:
            option = given[0].replace("_", "-")
            raise InputError(f"expected --ct, which the material of a surface comes from, with --{option}, got none")

    def sampling(self) -> Any:
        """What the pipeline samples."""
        from gpubspline.material.assign import Mapping
        from gpubspline.material.calibration_file import read_calibration
        from gpubspline.material.registry import DEFAULT_LAW
        from gpubspline.material.registry import law as find_law
        from gpubspline.recipe import Sampling

        policy: dict[str, Any] = {"policy": self.out_of_range}
        if self.floor_modulus is not None:
            if self.out_of_range != "floor":
                raise InputError(f"expected --floor-modulus with --out-of-range floor, got {self.out_of_range}")
            policy["floor_modulus_mpa"] = self.floor_modulus
        if self.order not in (1, 2):
            raise InputError(f"expected --order of 1 or 2, got {self.order}")
        counts = integers(self.nodes, "nodes", (2, 3, 4))
        across = None if self.transverse_law is None else find_law(self.transverse_law)
        mapping = Mapping(self.mapping, self.surface_depth, self.quadrature, across, policy)
        calibration = None if self.calibration is None else read_calibration(self.calibration)
        law = find_law(self.law or DEFAULT_LAW)
        return Sampling(law, counts, self.order, self.element, mapping, calibration, self.optimize)
