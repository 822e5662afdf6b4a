"""Laws by label: each part of a segmentation with its own law or constant, what has none with the law of the rest.

The labels are the element field ``label`` of the mesh. The material is by element, since a node between two labels has
both materials. The mesh gets the element field ``law`` (m,) int32: the label whose law an element has, 0 for the law of
the rest; ``material`` numbers the pieces of all laws on end, that of the rest first, then by rising label.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.material.alarms import Alarms
from gpubspline.material.integration import ElementMaterial
from gpubspline.material.laws import Law
from gpubspline.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Share:
    """The elements of one law.

    Attributes
    ----------
    label: whose law it is; 0 for the law of the rest.
    law: the law.
    elements: (s,) their numbers.
    """

    label: int
    law: Law
    elements: NDArray[np.intp]

    def part(self, mesh: Mesh) -> Mesh:
        """The mesh of these elements alone, on all nodes."""
        cells = mesh.cells_of(self.elements)
        return Mesh(mesh.points, mesh.element_type, connectivity=cells, fields=mesh.fields)


def shares(mesh: Mesh, law: Law, by_label: Mapping[int, Law]) -> list[Share]:
    """Part the elements by law, that of the rest first; laws that no element has are left out.

    Raises InputError where the mesh has no labels; warns of labels that no element has.
    """
    if "label" not in mesh.cell_fields:
        raise InputError("expected a mesh with the element field label for a law by label, got one without labels")
    label = mesh.cell_fields["label"]
    own = np.where(np.isin(label, list(by_label)), label, 0)
    found = [(number, np.flatnonzero(own == number)) for number in (0, *sorted(by_label))]
    missing = [str(number) for number, elements in found if number and not elements.size]
    if missing:
        words = f"no element has the label {', '.join(missing)}: its law is not used"
        warnings.warn(words, GpubsplineWarning, stacklevel=4)
    return [Share(number, by_label.get(number, law), elements) for number, elements in found if elements.size]


def joined(parts: Sequence[ElementMaterial], split: Sequence[Share]) -> ElementMaterial:
    """Material of a mesh from those of its shares."""
    if len(parts) == 1:
        return parts[0]
    order = np.argsort(np.concatenate([share.elements for share in split]))

    def join(name: str) -> NDArray[Any]:
        return np.asarray(np.concatenate([getattr(part, name) for part in parts])[order])

    names = ("hu", "density_g_cm3", "modulus_mpa", "poisson", "other_modulus_mpa", "piece", "mm3")
    gauss = {name: np.concatenate([part.gauss[name] for part in parts], axis=1)[:, order] for name in parts[0].gauss}
    return ElementMaterial(
        **{name: join(name) for name in names},
        points=sum(part.points for part in parts),
        points_outside=sum(part.points_outside for part in parts),
        mass_g=sum(part.mass_g for part in parts),
        gauss=gauss,
    )


def with_density(made: ElementMaterial, other: ElementMaterial) -> ElementMaterial:
    """The same with densities and mass of another kind."""
    gauss = made.gauss | {name: values for name, values in other.gauss.items() if name.startswith("density")}
    return replace(made, density_g_cm3=other.density_g_cm3, mass_g=other.mass_g, gauss=gauss)


def numbered(mesh: Mesh, materials: Sequence[NDArray[Any]], split: Sequence[Share]) -> dict[str, NDArray[np.int32]]:
    """Element fields ``material`` and ``law`` (m,), from the material of each share, 0 where a law was floored."""
    material, law, first = np.zeros(mesh.n_elements, np.int32), np.zeros(mesh.n_elements, np.int32), 0
    for share, own in zip(split, materials, strict=True):
        material[share.elements] = np.where(own > 0, own + first, 0)
        law[share.elements] = share.label
        first += len(share.law.pieces)
    return {"material": material, "law": law}


def told(share: Share, alarms: Alarms, made: ElementMaterial) -> dict[str, Any]:
    """Plain values of a share, of ``made`` by its own law; ``alarms`` have its mass, perhaps of another kind.

    ``density`` is the kind of its own law's density, of which it has ``mass_by_law_g``.
    """
    modulus_mpa = made.modulus_mpa
    spread = {"min": modulus_mpa.min(), "max": modulus_mpa.max(), "mean": modulus_mpa.mean(dtype=np.float64)}
    return {
        "label": share.label,
        "law": share.law.name,
        "elements": alarms.count,
        "outside_law": alarms.outside / alarms.count,
        "modulus_mpa": {name: float(value) for name, value in spread.items()},
        "mass_g": alarms.mass_mesh_g,
        "density": share.law.density.kind,
        "mass_by_law_g": None if alarms.mass_mesh_g is None else made.mass_g,
    }
