"""What makes one mesh better than another, and which places of the lattice are worth the time of making hexes."""

from itertools import pairwise, product
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gpubspline.mesh.blocks.merit import GOOD, MOST_MENDED, MOST_TRIED, Merit, hope, is_worth_trying, merit
from gpubspline.mesh.blocks.reach import MOST_LOST
from gpubspline.mesh.mend import POOR


def judged(*, wrong: float = 0, least: float = 0.7, determinant: float = 0.1, out: float = 0, off: float = 0) -> Merit:
    """Merit of a mesh of which so much is measured."""
    placed: Any = SimpleNamespace(nodes=SimpleNamespace(least=least))
    made = SimpleNamespace(placed=placed, least_determinant=determinant, farthest=out, off=off)
    return merit(cast(Any, SimpleNamespace(wrong=wrong)), cast(Any, made))


def test_from_best_to_worst() -> None:
    """Each is better than the next, whatever that has better in what counts later."""
    order = [
        judged(least=0.74),
        judged(least=0.61, out=MOST_LOST),
        judged(least=0.74, off=0.03),
        judged(least=0.74, out=MOST_LOST + 0.3),
        judged(least=0.74, wrong=1),
        judged(least=0.61, off=0.07),
        judged(least=0.74, wrong=2, out=MOST_LOST + 0.3),
        judged(least=0.74, determinant=0.01),
        judged(least=0.59),
        judged(least=0.59, off=0.5),
        judged(least=-0.1, off=0.5),
    ]
    assert all(better > worse for better, worse in pairwise(order))
    assert judged(off=0.001) == judged(off=0.019)


@pytest.mark.parametrize("several", [False, True])
def test_no_mesh_is_better_than_what_is_hoped_for_but_in_its_hexes(several: bool) -> None:
    for wrong, least, out, off in product((0, 1.5, 3), (0.5, 0.61, 0.74), (0, 2), (0, 0.03, 0.08)):
        made, hoped = judged(wrong=wrong, least=least, out=out, off=off), hope(wrong, several=several)
        assert (made.sound, made.wrong, made.off) <= (hoped.sound, hoped.wrong, hoped.off)


def test_places_that_are_worth_their_time() -> None:
    assert is_worth_trying(hope(9), None, 10 * MOST_MENDED)
    good, fair, poor = judged(least=GOOD), judged(least=POOR), judged(least=0.5)
    assert not is_worth_trying(hope(), good, 0) and is_worth_trying(hope(), fair, MOST_TRIED - 1)
    assert not is_worth_trying(hope(), fair, MOST_TRIED) and not is_worth_trying(hope(0.1), fair, 0)
    assert not is_worth_trying(hope(several=True), fair, 0)
    assert is_worth_trying(hope(3), poor, MOST_MENDED - 1) and not is_worth_trying(hope(3), poor, MOST_MENDED)
    assert is_worth_trying(hope(3), judged(least=0), MOST_MENDED)
    assert is_worth_trying(hope(), judged(off=0.03), 0) and is_worth_trying(hope(1), judged(off=0.07), 0)
