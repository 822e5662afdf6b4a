"""Closed forms at the theoretical order, graded elements beside constant ones, NAFEMS LE10, MacNeal and Harder."""

from typing import Any

import pytest

from gpubspline.bench import closed_forms as v
from gpubspline.bench import published

ORDERS = {"cantilever": (2, 3), "torsion": (2, 4), "cylinder": (2, 3)}
"""Theory's of hex8 and hex20: degree + 1 of displacements, twice the degree of the torque."""


def order(problem: Any, element_type: str, device: Any, cells: tuple[int, int], **how: Any) -> float:
    errors = tuple(problem(element_type, n, device, **how) for n in cells)
    return v.Study("", "", element_type, 0, cells, errors).observed


@pytest.mark.parametrize("problem", ORDERS)
@pytest.mark.parametrize(
    ("element_type", "formulation"), [("hex8", "full"), ("hex8", "incompatible"), ("hex20", "full")]
)
def test_closed_forms_are_approached_at_the_theoretical_order(problem, element_type, formulation, device64):
    """Between the two meshes, to a tenth; hex20's torque, whose corners are not smooth, to a third."""
    theory = ORDERS[problem][element_type == "hex20"]
    cells = (2, 4) if element_type == "hex20" and theory == 3 else (4, 8)
    found = order(getattr(v, problem), element_type, device64, cells, formulation=formulation)
    assert found > theory - (0.35 if theory == 4 else 0.1)


@pytest.mark.parametrize("grading", v.GRADED)
@pytest.mark.parametrize("problem", [v.graded_bar, v.graded_beam])
def test_graded_elements_converge_faster_than_constant_ones(problem, grading, device64):
    """hex20: order 2 where constant, above 3 where graded, and ten times nearer from 4 elements on."""
    constant, graded = (
        [problem(grading, "hex20", n, device64, modulus) for n in (4, 8)] for modulus in ("element", "graded")
    )
    assert all(10 * ours < theirs for ours, theirs in zip(graded, constant, strict=True))
    assert 1.7 < v.Study("", "", "", 2, (4, 8), tuple(constant)).observed < 2.3
    exact = problem is v.graded_beam and grading == "linear"
    assert graded[1] < v.EXACT if exact else v.Study("", "", "", 4, (4, 8), tuple(graded)).observed > 3


def test_graded_hex8_bends_better_than_constant_ones(device64):
    """With incompatible modes: a linear modulus is exact, an exponential one four times nearer."""
    linear = v.graded_beam("linear", "hex8", 4, device64, "graded")
    graded, constant = (v.graded_beam("exponential", "hex8", 4, device64, name) for name in ("graded", "element"))
    assert linear < v.EXACT and 4 * graded < constant


def test_nafems_le10(device64):
    """Sigma_yy at D, hex20: within 2 % of -5.38 MPa."""
    assert published.le10((6, 8, 4), device64) == pytest.approx(published.LE10_MPA, rel=0.02)


PINNED = {
    ("straight, trapezoidal", "in-plane shear"): 0.047,  # MacNeal's theorem of 1987: tapered elements lock
    ("straight, trapezoidal", "out-of-plane shear"): 0.030,
    ("straight, parallelogram", "in-plane shear"): 0.624,
    ("straight, parallelogram", "out-of-plane shear"): 0.528,
    ("curved", "in-plane shear"): 0.880,
    ("curved", "out-of-plane shear"): 0.809,
}
"""Of incompatible modes, where the element is not near the published value."""


def test_macneal_and_harders_beams(device64):
    """Incompatible modes: within 3 % of the published values, or as pinned; without them beams hardly bend."""
    for row in published.macneal_harder(device64):
        expected = PINNED.get((row.problem, row.quantity))
        tolerance = 0.03 if expected is None else 0.002
        assert row.ratio("incompatible") == pytest.approx(expected or 1.0, abs=tolerance), row
        assert row.quantity == "extension" or row.ratio("full") < 0.34
