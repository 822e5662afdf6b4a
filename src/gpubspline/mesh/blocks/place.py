"""Where nodes go: the surface on to the level set, the hexes improved, and again where faces cut off volume."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.mesh.blocks.chords import measure_chords
from gpubspline.mesh.blocks.labelled import Held, Interfaces, level_volumes, straightened
from gpubspline.mesh.blocks.level_set import SAMPLES, Field, LevelSet, bulged, volume_inside
from gpubspline.mesh.blocks.pillow import Pillowed
from gpubspline.mesh.blocks.reach import CoreDistance, within_reach
from gpubspline.mesh.blocks.start import start
from gpubspline.mesh.even import even_out
from gpubspline.mesh.floors import ANY_LENGTH, Effort, Placed, copy
from gpubspline.mesh.improve import lift, settle
from gpubspline.mesh.mend import POOR, as_long_as_now
from gpubspline.mesh.movable import Movable, movable, put_level

FEW = 0.004
"""Share of the volume that faces may cut off."""

ROUNDS = 3
"""Most times that nodes are placed again for it: on a rod of two elements faces cut off a tenth, and one round brings
back four fifths of it.
"""

SLOW = 0.5
"""Share of what lacked before one round, above which it is no longer faces that cut it off but parts without hexes: to
go on would blow up the hexes that there are.
"""

STEPS = 20
"""Most steps of descent of all hexes where they are placed again, near to where they were."""

LEAST_LENGTH = 0.3
"""Shortest, in elements, that edges of bodies that touch are asked to be; longer ones are to stay as they start:
thin bodies have three hexes across an element, which would push the surface out if they were to be as long as others.
"""


@dataclass(frozen=True, eq=False)
class Holding:
    """Hexes, and what their nodes are held by.

    ``core``: the distance that keeps them near it, where something does.
    """

    hexes: Pillowed
    held: Held
    core: CoreDistance | None
    interfaces: Interfaces
    device: Device

    def by(self, wanted: Field) -> tuple[Movable, Field]:
        """Hold the nodes by a level set, as far as the core reaches; gives that too."""
        reached = wanted if self.core is None else within_reach(wanted, self.core)
        volumes = level_volumes(reached, self.interfaces, self.held)
        volume = np.stack(volumes) if len(volumes) > 1 else reached
        level = put_level(volume, np.hstack([np.eye(3) * SAMPLES, np.zeros((3, 1))]), self.device)
        cells, n, held = self.hexes.cells, self.hexes.n_nodes, self.held
        return movable(cells, n, held.slack, level, self.device, levels=held.levels), reached


@dataclass(frozen=True, eq=False)
class PlacedOn:
    """Hexes with their nodes in place, and the level set that these are on."""

    hexes: Movable
    nodes: Placed
    reached: Field

    @property
    def points(self) -> NDArray[Any]:
        """(n, 3) nodes, lattice coordinates."""
        return np.asarray(np.array(self.hexes.device.get(self.nodes.x)).reshape(3, -1).T)


def place_nodes(holding: Holding, level: LevelSet, effort: Effort | None, *, bulge: bool) -> PlacedOn:
    """Place the nodes of hexes; ``bulge``: outside the level set, by as much as faces cut off."""
    hexes, reached = holding.by(bulged(level.phi) if bulge else level.phi)
    colours, slack, several = holding.hexes.colours, holding.held.slack, bool(holding.interfaces)
    x, effort = start(holding.hexes, hexes), effort or Effort()
    if several:
        hexes, effort = as_long_as_now(hexes, x, LEAST_LENGTH), replace(effort, **ANY_LENGTH)
    first = PlacedOn(hexes, settle(hexes, x, slack, effort), reached)
    if several:
        first = _lifted(first, colours, effort)
    again = _straightened(holding, first, level.phi, effort) if bulge and first.nodes.least > 0 else first
    if again is not first:
        made = _lifted(again, colours, effort)
        if made.nodes.least >= POOR:
            return made
        first = first if several else _lifted(first, colours, effort)
        return made if made.nodes.least >= first.nodes.least else first
    return first if several else _lifted(first, colours, effort)


def _straightened(holding: Holding, settled: PlacedOn, phi: Field, effort: Effort) -> PlacedOn:
    """Move what holds the nodes by how far the faces between them lie off, round after round while that is much."""
    volume, wanted, several = volume_inside(phi), bulged(phi), bool(holding.interfaces)
    before = np.inf
    for _ in range(1 if several else ROUNDS):
        chords = measure_chords(settled.points, holding.hexes.quads, phi, volume)
        lacking = abs(chords.volume)
        if not several and (lacking <= FEW * volume or lacking > SLOW * before):
            break
        before = lacking
        wanted = chords.added_to(wanted)
        settled = _settled_again(holding, settled, wanted, effort)
    return settled


def _settled_again(holding: Holding, first: PlacedOn, wanted: Field, effort: Effort) -> PlacedOn:
    """Go on from where nodes are to another level set near by, and to straightened interfaces."""
    if holding.interfaces:
        holding = replace(holding, interfaces=straightened(holding.interfaces, holding.hexes, first.points))
    else:
        effort = replace(effort, steps=min(STEPS, effort.steps))
    hexes, reached = holding.by(wanted)
    hexes = replace(hexes.with_slack(first.nodes.slack), log_lengths=first.hexes.log_lengths, scale=first.hexes.scale)
    return PlacedOn(hexes, settle(hexes, copy(hexes, first.nodes.x), first.nodes.slack, effort), reached)


def _lifted(settled: PlacedOn, colours: NDArray[Any], effort: Effort) -> PlacedOn:
    """Raise the floor, then draw out short edges."""
    hexes, nodes = lift(settled.hexes, colours, settled.nodes, effort)
    return replace(settled, hexes=hexes, nodes=even_out(hexes, nodes))
