"""Why a mesh has another mass than the voxels: cracks that it fills are told from HU that are interpolated."""

import numpy as np
import pytest

from gpubspline.ct.region import Region, region_from_mask
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.material.alarms import mass_advice
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.mesh.mesh import Mesh

LAW = Law("linear", "rho", DensityRelation("apparent", 0.001), (Piece(1.0, 3000.0, 1000.0, 1.0),))


def scan(crack: slice = slice(0, 0)) -> tuple[Volume, Region]:
    """A box of 20 x 20 x 20 voxels of a millimetre, 1,000 HU in 10, with slices of a crack of 10 HU."""
    hu, inside = np.full((24, 24, 24), 10, np.float32), np.zeros((24, 24, 24), dtype=bool)
    inside[2:22, 2:22, 2:22] = True
    inside[crack, :18] = False
    hu[inside] = 1000
    volume = Volume(hu, np.eye(4))
    return volume, region_from_mask(volume, inside, smoothing_mm=0.0, largest=False)


def box(n: int = 11, share: float = 1.0) -> Mesh:
    """Even hexes over the box, the nodes' HU a share of the body's."""
    line = np.linspace(1.5, 21.5, n)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    return Mesh(points, "hex8", structure=(n, n, n), fields={"HU": np.full(len(points), 1000.0 * share)})


@pytest.mark.parametrize("how", ["nodal", "element-e"])
def test_a_crack_that_is_filled(how: str, device: Device) -> None:
    """Four slices, open to one side, 20 x 16 x 4 mm3, and the region's rounded edges.

    Within reach of the surface a place outside takes the HU of its mirror image, in the crack, too: there is bone then.
    """
    volume, region = scan(slice(8, 12))
    _, alarms = assign(box(), LAW, Mapping(how), volume=volume, region=region, device=device)
    parts = alarms.mass_parts
    assert parts is not None and abs(parts.between_nodes_g) < (0.3 if how == "nodal" else 1e-4)
    assert 1280 < parts.filled_mm3 < 1450 and parts.left_mm3 < 100 and 0.9 < parts.filled_g < 1.4
    said = mass_advice(alarms.to_dict())
    assert said.startswith("it fills 1,") and "outside the region, such as cracks" in said
    above = mass_advice(alarms.to_dict(), {"mesh": 8000.0, "region": region.volume_mm3})
    assert above.startswith("its volume is 19.2% above the region's: it fills 1,")
    bare = Mapping(how, partial_volume="none")
    _, alarms = assign(box(), LAW, bare, volume=volume, region=region, device=device)
    assert alarms.mass_parts is not None and alarms.mass_parts.filled_g < 0.3


def test_what_is_lost_between_nodes(device: Device) -> None:
    """A tenth of the HU of every node, as of peaks that are cut off: no word of the shape; within 1 % none at all."""
    volume, region = scan()
    _, alarms = assign(box(share=0.9), LAW, volume=volume, region=region, device=device)
    parts = alarms.mass_parts
    assert parts is not None and parts.between_nodes_g == pytest.approx(-0.8, rel=0.03)
    assert "interpolated between nodes" in mass_advice(alarms.to_dict(), {"mesh": 8000.0, "region": 8000.0})
    _, fine = assign(box(), LAW, volume=volume, region=region, device=device)
    assert abs(fine.mass_difference or 1) < 0.01 and fine.mass_parts is None
