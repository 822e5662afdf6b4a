"""Limited-memory BFGS for nodes that slide: descent of the energy of movable hexes on a device."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.mesh.movable import Goal, Movable

MEMORY = 12
"""Pairs of steps and changes of the gradient that are kept."""

ROWS = 2 * MEMORY + 1

PARTS, RUN = 4096, 256
"""Most partial sums of a product, added on the host in float64, and how many elements each has at least."""

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
    products: NDArray[np.float64] = field(default_factory=lambda: np.zeros((ROWS, ROWS)))
    pairs: list[int] = field(default_factory=list)

    def remember(self, slot: int, x: Buffer, x_new: Buffer, g: Buffer, g_new: Buffer) -> None:
        """Take in a step and the gradients at its ends; it counts if the energy curves upward along it."""
        parts, device = min(-(-self.n // RUN), PARTS), self.device
        device.launch("quasi_newton.remember", self.n, x, x_new, g, g_new, self.scale, slot, MEMORY, self.n, self.basis)
        sums = device.empty((3, ROWS, parts))
        device.launch("quasi_newton.row_products", ROWS * parts, self.basis, slot, MEMORY, self.n, parts, sums)
        found = np.asarray(device.get(sums)).reshape(3, ROWS, parts).sum(axis=2, dtype=np.float64)
        for row, values in zip((slot, MEMORY + slot, ROWS - 1), found, strict=True):
            self.products[row] = self.products[:, row] = values
        if slot in self.pairs:
            self.pairs.remove(slot)
        if self.products[slot, MEMORY + slot] > 1e-10 * self.products[MEMORY + slot, MEMORY + slot]:
            self.pairs.append(slot)

    def direction(self) -> NDArray[np.float64]:
        """Coefficients (ROWS,) of the descent direction over the rows."""
        q = np.zeros(ROWS)
        q[-1] = -1.0
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
    memory = Memory(device, n, device.put(np.zeros(ROWS * n, dtype=np.float32)), hexes.scale)
    g, g_new, d = (device.empty(n) for _ in range(3))
    x_new, planes = device.empty(hexes.planes * hexes.n_nodes), hexes.planes
    hexes.slide(x)
    energy = hexes.evaluate(x, goal, g)
    memory.remember(0, x, x, g, g)
    slot = 0
    for step in range(steps):
        size = memory.products[-1, -1]
        if size <= 1e-14 * n or energy <= 0:
            break
        coefficients = device.put(memory.direction())
        device.launch("quasi_newton.combine_rows", n, memory.basis, coefficients, ROWS, hexes.scale, n, d)
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
        memory.remember(slot, x, x_new, g, g_new)
        slot = (slot + 1) % MEMORY
        x, x_new, g, g_new, energy = x_new, x, g_new, g, energy_new
        if watch is not None:
            watch(step, energy)
    hexes.slide(x)
    return x, energy


def _largest(device: Device, d: Buffer) -> float:
    return max(float(np.abs(device.get(d)).max()), 1e-30)
