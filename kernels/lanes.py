"""Vector lanes on Warp's CPU device.

Warp's compiler does not vectorise across work items. A kernel whose arrays are ``LaneArray`` and whose last argument is
``lanes`` is instantiated by the Warp device for vectors of ``lanes`` neighbouring elements there, and for scalars
(``lanes`` 1) on a GPU: an index is that of the first of them, and a work item handles the elements
``min(item * lanes, n - lanes)`` and on of the fastest dimension. The OpenCL twin of this is ``lanes.h``.
"""

from typing import Any

import warp as wp

LaneArray = wp.array(dtype=Any)
