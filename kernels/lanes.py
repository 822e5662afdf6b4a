"""Vector lanes in Warp.

Warp's CPU compiler does not vectorise across work items. A ``LaneArray`` is an array of overlapping vectors, one that
begins at every element: its index is that of an element, and what it holds there are this element and its next
neighbours. The Warp device chooses the length: many where the kernel's last argument is ``lanes`` and the device is a
CPU, else one. A work item then handles the elements ``min(item * lanes, n - lanes)`` and on of the fastest dimension,
so that the last vector of a row overlaps the one before it. The OpenCL twin of this is ``lanes.h``.
"""

from typing import Any

import warp as wp

LaneArray = wp.array(dtype=Any)

IntLaneArray = wp.array(dtype=Any)
"""A LaneArray of int32."""

REGISTER_BYTES = 64
"""Of a CPU's vectors. A module with this as its ``REGISTER`` gets lanes for one register, unless a row holds fewer."""
# Lanes are loops: not unrolled before they are made vectors, each becomes one instruction, or up to 4 where registers
# are shorter. Products and sums may be fused: for what need not round alike on both backends, as meshes must. Vectors
# kept on a stack that is not aligned to them lie in two lines of the cache each.
FUSED = "-march=native -mllvm=-inline-threshold=40000 -mllvm=-unroll-full-max-count=4 -ffp-contract=fast -mstackrealign"


@wp.func
def inverse_root(squared: Any):
    """1 / sqrt of each lane, 0 where it is 0."""
    result = squared
    for lane in range(len(squared)):
        value = squared[lane]
        none = type(value)(0.0)
        result[lane] = wp.where(value > none, type(value)(1.0) / wp.sqrt(value), none)
    return result


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(reinterpret_cast<const char*>(plane.data) + size_t(at) * plane.strides[0]);
#endif
""")
def fetch(plane: wp.array(dtype=Any), at: wp.int32) -> None:
    """Ask a CPU's caches for what will be needed."""


# Elements of a flat array without the stride and the count from its end that Warp allows for: on a GPU they cost more
# than much arithmetic. Arrays have less than 2^31 elements. What is asserted, Warp's debug builds check.
ELEMENT = "assert(at >= 0 && at < values.shape[0]); return values.data[at];"


@wp.func_native(ELEMENT)
def element(values: wp.array(dtype=wp.float32), at: wp.int32) -> wp.float32: ...


@wp.func_native(ELEMENT)
def element(values: wp.array(dtype=wp.float64), at: wp.int32) -> wp.float64: ...  # noqa: F811


@wp.func_native(ELEMENT)
def element(values: wp.array(dtype=wp.int32), at: wp.int32) -> wp.int32: ...  # noqa: F811


@wp.func_native("assert(at >= 0 && at < values.shape[0]); values.data[at] = value;")
def set_element(values: wp.array(dtype=Any), at: wp.int32, value: Any) -> None: ...


@wp.func_native("""
    assert(at >= 0 && at < values.shape[0]);
#if defined(__CUDA_ARCH__)
    __stcs(values.data + at, value);
#else
    values.data[at] = value;
#endif
""")
def stream(values: wp.array(dtype=Any), at: wp.int32, value: Any) -> None:
    """Set an element that is not read again soon, and should leave the caches first."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    float root;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(value)); // what rsqrtf is but for what is hardly more than 0
    return root;
#else
    return 1 / ::sqrt(value);
#endif
""")
def root_of_inverse(value: wp.float32) -> wp.float32: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrt(value);
#else
    return 1 / ::sqrt(value);
#endif
""")
def root_of_inverse(value: wp.float64) -> wp.float64: ...  # noqa: F811
