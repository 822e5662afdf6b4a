"""A law over nodal HU: density, modulus, Poisson's ratio and the piece used.

Floors, a node: HU read and four values written, 20 bytes. Operations: comparisons with both ends of each piece, a
multiplication and an addition for the density, and a power, which is two polynomials: about 80 with two pieces. Held
against ``moving``.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.measure import Place, Row, best_of, time_peers
from gpubspline.bench.recorder import Recorder
from gpubspline.material.laws import Law
from gpubspline.material.mapping import map_material
from gpubspline.material.registry import law as find_law

SIZES = {"full": 8_000_000, "quick": 2_000_000, "tiny": 1000}
BYTES = 20


def rows(place: Place) -> Iterator[Row]:
    """Time the default law over random HU of its ranges."""
    law, n, recorder = find_law(), SIZES[place.scale], Recorder(place.device)
    ends = law.pieces[0].lower_hu, law.pieces[-1].upper_hu
    hu = np.random.default_rng(8).uniform(*ends, n).astype(np.float32)
    made = map_material(hu, law, device=recorder)
    planes = np.stack([made.density_g_cm3, made.modulus_mpa, made.poisson])
    others = time_peers("material", planes, 1e-5, {"numpy": lambda: (lambda: _numpy(hu, law), np.stack)})
    seconds, floor = best_of(recorder.replay), BYTES * n / place.moving
    yield Row("material", f"{n:,} nodes", place.device.name, seconds, n, floor / seconds, others)


def _numpy(hu: NDArray[np.float32], law: Law) -> list[Any]:
    """Density, modulus and Poisson's ratio, a piece at a time over the nodes that it holds."""
    density = law.density.slope_g_cm3_per_hu * hu + law.density.intercept_g_cm3
    modulus, poisson = np.empty_like(hu), np.empty_like(hu)
    piece = np.searchsorted([piece.lower_hu for piece in law.pieces], hu, side="right") - 1
    for number, part in enumerate(law.pieces):
        held = piece == number
        modulus[held] = part.factor_mpa * density[held] ** part.exponent + part.offset_mpa
        poisson[held] = part.poisson
    return [density, modulus, poisson]
