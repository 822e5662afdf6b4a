"""Limited-memory BFGS for nodes that slide: descent of the energy of movable hexes on a device."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.device.vectors import products
from gpubspline.mesh.movable import Goal, Movable

MEMORY = 12
"""Pairs of steps and changes of the gradient that are kept."""

FIRST_STEP = 0.1
"""How far the first step moves the node that it moves farthest, in target lengths."""

HALVINGS = 6
"""How often a step is halved before the memory is dropped."""


@dataclass(eq=False)
class Memory:
    """The last steps, changes of the gradient and the gradient: rows of a basis on the device, with their products.

    Rows 0 to MEMORY - 1 are steps, the next MEMORY changes, the last is the gradient. All are of coordinates in units
    of each node's size, so that one step length suits small and large elements.
    """

    device: Device
    n: int
    basis: Buffer
    scale: Buffer
    products: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2 * MEMORY + 1,) * 2))
    pairs: list[int] = field(default_factory=list)

    def set_row(self, row: int, x: Buffer, y: Buffer) -> None:
        """Put the difference x - y of places, or of gradients, into a row."""
        inverse = int(row < MEMORY)
        self.device.launch("quasi_newton.set_difference", self.n, x, y, self.scale, inverse, self.n, row, self.basis)

    def multiply(self, row: int) -> None:
        """Bring the products of a row with all rows up to date."""
        rows = 2 * MEMORY + 1
        found = products(self.device, self.basis, self.basis, self.n, row=row, rows=rows)
        self.products[row] = self.products[:, row] = found

    def direction(self) -> NDArray[np.float64]:
        """Coefficients (2 MEMORY + 1) of the descent direction over the rows."""
        last, q = 2 * MEMORY, np.zeros(2 * MEMORY + 1)
        q[last] = -1.0
        alpha = {}
        for s in reversed(self.pairs):
            alpha[s] = q @ self.products[:, s] / self.products[s, MEMORY + s]
            q[MEMORY + s] -= alpha[s]
        if self.pairs:
            s = self.pairs[-1]
            q *= self.products[s, MEMORY + s] / self.products[MEMORY + s, MEMORY + s]
        for s in self.pairs:
            beta = q @ self.products[:, MEMORY + s] / self.products[s, MEMORY + s]
            q[s] += alpha[s] - beta
        return q


Watch = Callable[[int, float], None]


def descend(
    hexes: Movable, x: Buffer, goal: Goal, *, steps: int, cap: float, watch: Watch | None = None
) -> tuple[Buffer, float]:
    """Lower the energy from x (3, n) by at most ``steps`` steps, none of which moves a node farther than ``cap``.

    Returns
    -------
    the nodes and their energy, never above that of x slid to its level.
    """
    device, n = hexes.device, 3 * hexes.n_nodes
    memory = Memory(device, n, device.put(np.zeros((2 * MEMORY + 1) * n)), hexes.scale)
    zero = device.put(np.zeros(n))
    g, g_new, d = (device.empty(n) for _ in range(3))
    x_new, planes = device.empty(hexes.planes * hexes.n_nodes), hexes.planes
    hexes.slide(x)
    energy = hexes.evaluate(x, goal, g)
    memory.set_row(2 * MEMORY, g, zero)
    memory.multiply(2 * MEMORY)
    slot = 0
    for step in range(steps):
        size = memory.products[2 * MEMORY, 2 * MEMORY]
        if size <= 1e-14 * n or energy <= 0:
            break
        device.launch(
            "quasi_newton.combine_rows",
            n,
            memory.basis,
            device.put(memory.direction()),
            2 * MEMORY + 1,
            hexes.scale,
            n,
            d,
        )
        length = 1.0 if memory.pairs else FIRST_STEP / _largest(device, d)
        for _ in range(HALVINGS):
            device.launch("optimize.move", hexes.n_nodes, x, planes, d, hexes.n_nodes, length, cap, hexes.scale, x_new)
            hexes.slide(x_new)
            energy_new = hexes.evaluate(x_new, goal, g_new)
            if energy_new < energy:
                break
            length *= 0.5
        else:
            if not memory.pairs:
                break
            memory.pairs.clear()
            continue
        _put_pair(memory, slot, (x_new, x), (g_new, g))
        slot = (slot + 1) % MEMORY
        x, x_new, g, g_new, energy = x_new, x, g_new, g, energy_new
        memory.set_row(2 * MEMORY, g, zero)
        memory.multiply(2 * MEMORY)
        if watch is not None:
            watch(step, energy)
    hexes.slide(x)
    return x, energy


def _put_pair(memory: Memory, slot: int, step: tuple[Any, ...], change: tuple[Any, ...]) -> None:
    """Remember a step and the change of the gradient along it, if the energy curves upward there."""
    for row, (new, old) in ((slot, step), (MEMORY + slot, change)):
        memory.set_row(row, new, old)
        memory.multiply(row)
    if slot in memory.pairs:
        memory.pairs.remove(slot)
    curvature = memory.products[slot, MEMORY + slot]
    if curvature > 1e-10 * memory.products[MEMORY + slot, MEMORY + slot]:
        memory.pairs.append(slot)


def _largest(device: Device, d: Buffer) -> float:
    return max(float(np.abs(device.get(d)).max()), 1e-30)
