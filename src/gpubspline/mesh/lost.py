"""What a mesh leaves out of its region, by all that was found, and how thick it is."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from gpubspline.ct.region import Region
from gpubspline.mesh.thickness import measure_thickness


def list_lost(
    found: Sequence[dict[str, Any]], covered: Sequence[dict[str, Any]], region: Region
) -> list[dict[str, Any]]:
    """List parts left out, each once, farthest out first, with their thickness.

    A mesher knows what its lattice lost of the surface that it follows; that surface itself is smoothed, and what it
    left out of the region is found by measuring.

    Arguments
    ---------
    found, covered: by the mesher and by measuring, ``place_mm`` and ``out_mm`` of each.
    region: what was meshed.

    Returns
    -------
    the same, each with ``thickness_mm``: the greatest of the region within ``out_mm`` of the place, where there is no
    mesh.
    """
    known = list(covered)
    for feature in found:
        far = [np.linalg.norm(np.subtract(feature["place_mm"], other["place_mm"])) for other in covered]
        if all(away > max(feature["out_mm"], other["out_mm"]) for away, other in zip(far, covered, strict=True)):
            known.append(feature)
    if not known:
        return []
    thick = measure_thickness(region)
    tree = KDTree(thick.places_mm)
    listed = []
    for feature in sorted(known, key=lambda each: -float(each["out_mm"])):
        near = tree.query_ball_point(feature["place_mm"], feature["out_mm"]) or tree.query(feature["place_mm"])[1]
        listed.append({**feature, "thickness_mm": float(np.max(thick.thickness_mm[near]))})
    return listed
