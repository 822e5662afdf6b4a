"""How the mesh is sampled, and what its material is."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import complete_element, complete_law, complete_mapping, option
from gpubspline.cli.options.texts import integers, law_of_label
from gpubspline.errors import InputError


@dataclass
class SamplingOptions:
    """How the mesh is sampled, and what its material is."""

    nodes: Annotated[
        str | None, option("Mesh", "samples per direction (default: as control points)", metavar="U,V[,[R,]W]")
    ] = None
    order: Annotated[int, option("Mesh", "1: quad4, hex8; 2: quad8, hex20", metavar="1|2")] = 1
    element: Annotated[
        str | None,
        option("Mesh", "element type, such as hex27 (default: by --order)", metavar="TYPE", complete=complete_element),
    ] = None
    optimize: Annotated[
        bool, option("Mesh", "move nodes for better hexes, those of the surface along it", "--optimize")
    ] = False
    law: Annotated[
        list[str] | None,
        option(
            "Material",
            "see 'gpubspline laws' (default: wirtz-2000), or constant:E=MPA,nu=N[,rho=G_CM3]; LABEL=LAW for a label of "
            "--labels alone, once for each",
            metavar="[LABEL=]LAW",
            complete=complete_law,
        ),
    ] = None
    out_of_range: Annotated[str, option("Material", "HU that the law does not cover", metavar="clamp|floor|error")] = (
        "clamp"
    )
    floor_modulus: Annotated[float | None, option("Material", "modulus of 'floor' (default: 1)", metavar="MPA")] = None
    mapping: Annotated[
        str | None,
        option(
            "Material",
            "law at nodes or Gauss points (nodal, gauss); of the mean HU round a node or in an element (nodal-hu, "
            "element-hu), or its mean there (nodal-e, element-e) (default: nodal; element-e with laws of labels)",
            metavar="HOW",
            complete=complete_mapping,
        ),
    ] = None
    transverse_law: Annotated[
        str | None,
        option(
            "Material",
            "law across w: orthotropic elements, --law along w (default: isotropic)",
            metavar="NAME|FILE.toml",
            complete=complete_law,
        ),
    ] = None
    quadrature: Annotated[
        int | None, option("Material", "points per direction of *-hu and *-e (default: by the voxels)", metavar="N")
    ] = None
    surface_depth: Annotated[
        float | None,
        option("Material", "read HU near the surface this far inside (default: where they lie)", metavar="MM"),
    ] = None
    calibration: Annotated[
        Path | None,
        option(
            "Material",
            "HU to density: line, table, rods or tissues; phantomless: air, fat and muscle of the scan (default: the "
            "law's own)",
            metavar="phantomless|FILE.toml",
        ),
    ] = None

    def __post_init__(self) -> None:
        """Take no law for none."""
        self.law = self.law or None

    @property
    def files(self) -> list[Path]:
        """Files that are read, among them names of laws, which are none."""
        laws = [law_of_label(text)[1] for text in self.law or ()]
        return [Path(name) for name in (*laws, self.transverse_law, self.calibration) if name]

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

    def sampling(self, labels: Path | None = None) -> Any:
        """What the pipeline samples; ``labels`` is the segmentation that laws of labels need."""
        from gpubspline.material.assign import Mapping
        from gpubspline.material.calibration_file import read_calibration
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
        law, by_label = self._laws()
        how = self.mapping or ("element-e" if by_label else "nodal")
        mapping = Mapping(how, self.surface_depth, self.quadrature, across, policy)
        calibration = None if self.calibration is None else read_calibration(self.calibration)
        if by_label:
            mapping.check_by_label()
            if labels is None:
                raise InputError(f"expected --labels FILE with the law of a label, {next(iter(by_label))}, got none")
        return Sampling(law, counts, self.order, self.element, mapping, calibration, self.optimize, by_label)

    def _laws(self) -> tuple[Any, dict[int | str, Any]]:
        """Law of what has none of its own, and those of labels."""
        from gpubspline.material.registry import DEFAULT_LAW
        from gpubspline.material.registry import law as find_law

        rest: str | None = None
        given: dict[int | str, str] = {}
        for label, name in map(law_of_label, self.law or ()):
            if label in given or (label is None and rest is not None):
                what = "all that has no law of its own" if label is None else f"the label {label}"
                raise InputError(f"expected one --law for {what}, got {given.get(label or '', rest)} and {name}")
            if label is None:
                rest = name
            else:
                given[label] = name
        law = find_law(DEFAULT_LAW if rest is None else rest)
        return law, {label: find_law(name).beside(law) for label, name in given.items()}
