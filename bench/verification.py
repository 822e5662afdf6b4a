"""Closed forms and published benchmarks beside what the solver finds: ``python -m gpubspline.bench.verification``.

Prints the tables of ``docs/verification.md``, and writes them to the file that is given.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from gpubspline.bench.closed_forms import EXACT, Study, gradings, studies
from gpubspline.bench.published import LE10, LE10_MPA, le10, macneal_harder
from gpubspline.device import Device, open_device

HEADING = """# Verification

What the solver finds beside closed forms and published benchmarks, in float64. Written by
`python -m gpubspline.bench.verification docs/verification.md`; `tests/analysis/test_verification.py` asserts it.
"""

CONVERGENCE = """
## Convergence to closed forms

Relative errors of meshes with the given numbers of elements along one side, and the order between the two finest.

- cantilever: 4 x 1 x 1 under an end shear, nu = 0; Timoshenko and Goodier, art. 21.
- torsion of a prism: square section, free to warp, nu = 0.3; art. 109.
- thick cylinder: radii 1 and 2 under inner pressure, plane strain, nu = 0.3; Lame, art. 28.
"""

GRADING = """
## Graded elements beside constant ones

A modulus that grows from 100 to 700: along a bar that is pulled, F / A = u / (integral of 1 / E), and across the height
of a beam that is bent, M = k (integral of E (z - z0)^2). Graded elements interpolate the nodes' moduli, constant ones
take their mean. hex8 has incompatible modes in the beam. Along a bar the strain of hex8 is even in each element: both
take the same mean; curved elements, and any element in bending, gain by the grading: the linear one is exact.
"""

BEAMS = """
## MacNeal and Harder's beams, hex8

Displacement of the tip over the published value. 6 elements, twisted 12 x 2. Source: MacNeal and Harder 1985, "A
proposed standard set of problems to test finite element accuracy". Trapezoids lock with or without modes: no such
element that passes the patch test escapes it (MacNeal 1987, "A theorem regarding the locking of tapered four-noded
membrane elements").
"""


def tables(device: Device) -> Iterator[str]:
    """Lines of the document, as they are found."""
    yield HEADING
    for text, found in ((CONVERGENCE, studies(device)), (GRADING, gradings(device))):
        yield text
        yield "| problem | error of | elements | " + " | ".join(["meshes", "errors", "order", "theory"]) + " |"
        yield "|---" * 7 + "|"
        yield from map(_line, found)
    yield "\n## NAFEMS LE10\n"
    yield "Thick plate under pressure, sigma_yy at D, published -5.38 MPa, hex20. Source: NAFEMS 1990.\n"
    yield "| elements | sigma_yy, MPa | over published |"
    yield "|---|---|---|"
    for cells in LE10:
        stress = le10(cells, device)
        yield f"| {' x '.join(map(str, cells))} | {stress:.3f} | {stress / LE10_MPA:.3f} |"
    yield BEAMS
    yield "| beam | load | published | full | incompatible | bbar |"
    yield "|---" * 6 + "|"
    for row in macneal_harder(device):
        ratios = " | ".join(f"{row.ratio(kind):.3f}" for kind in row.found)
        yield f"| {row.problem} | {row.quantity} | {row.expected:g} | {ratios} |"


def _line(study: Study) -> str:
    errors = ", ".join(f"{error:.1e}" if error > EXACT else "0" for error in study.errors)
    order = f"{study.observed:.2f}" if study.errors[-1] > EXACT else "exact"
    cells = ", ".join(map(str, study.cells))
    return f"| {study.problem} | {study.error} | {study.element} | {cells} | {errors} | {order} | {study.order:g} |"


if __name__ == "__main__":
    lines = []
    for line in tables(open_device("auto", "float64")):
        sys.stdout.write(line + "\n")
        lines.append(line)
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text("\n".join(lines) + "\n")
