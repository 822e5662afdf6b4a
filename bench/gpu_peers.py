"""What others make of the same work on a GPU: CuPy and PyTorch, where they are installed; inputs lie there before."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.measure import Peer, peer


def contractions(control: NDArray[Any], matrices: Sequence[Any]) -> dict[str, Peer]:
    """Values of a patch as products of matrices, which run at the rate of the vendor's own library for them.

    Arguments
    ---------
    control: (n_u, n_v, n_w, K).
    matrices: sparse, (nodes, control points) along u, v and w.
    """
    return {"CuPy": partial(_contraction, control, matrices)}


def _contraction(control: NDArray[Any], matrices: Sequence[Any]) -> tuple[Any, Any]:
    cupy = peer("cupy")
    u, v, w = (cupy.asarray(matrix.toarray(), dtype=np.float32) for matrix in matrices)
    planes = cupy.asarray(np.ascontiguousarray(control.T), dtype=np.float32)  # K, w, v, u
    channels, n_w = planes.shape[:2]

    def run() -> Any:
        rows = planes @ u.T  # K, w, v, nodes along u
        rows = cupy.matmul(v, rows)  # K, w, nodes along v, u
        whole = cupy.matmul(w, rows.reshape(channels, n_w, -1))  # K, nodes along w, v u
        cupy.cuda.get_current_stream().synchronize()
        return whole

    return run, lambda whole: _numpy(cupy, whole.reshape(channels, len(w), len(v), len(u)))


def samples(volume: NDArray[Any], indices: NDArray[Any]) -> dict[str, Peer]:
    """Trilinear values of a volume.

    Arguments
    ---------
    volume: (k, j, i).
    indices: (n, 3) places in it, k, j, i.
    """
    return {"CuPy": partial(_map_coordinates, volume, indices), "PyTorch": partial(_grid_sample, volume, indices)}


def _map_coordinates(volume: NDArray[Any], indices: NDArray[Any]) -> tuple[Any, Any]:
    cupy, ndimage = peer("cupy"), peer("cupyx.scipy.ndimage")
    values, at = cupy.asarray(volume), cupy.asarray(np.ascontiguousarray(indices.T))

    def run() -> Any:
        found = ndimage.map_coordinates(values, at, np.float32, order=1, mode="nearest")
        cupy.cuda.get_current_stream().synchronize()
        return found

    return run, partial(_numpy, cupy)


def _numpy(cupy: Any, array: Any) -> Any:
    """The array on the host; what CuPy keeps for later goes back to the device."""
    found = cupy.asnumpy(array)
    cupy.get_default_memory_pool().free_all_blocks()
    return found


def _grid_sample(volume: NDArray[Any], indices: NDArray[Any]) -> tuple[Any, Any]:
    torch = peer("torch")
    if not torch.cuda.is_available():
        raise ImportError("PyTorch sees no GPU")
    sizes = np.array(volume.shape, dtype=np.float32)
    from_minus_one = (2 * indices / (sizes - 1) - 1).astype(np.float32)[:, ::-1]  # i, j, k
    values = torch.from_numpy(volume)[None, None].cuda()
    at = torch.from_numpy(np.ascontiguousarray(from_minus_one))[None, None, None].cuda()

    def run() -> Any:
        found = torch.nn.functional.grid_sample(values, at, padding_mode="border", align_corners=True)
        torch.cuda.synchronize()
        return found

    return run, lambda found: found.reshape(-1).cpu().numpy()
