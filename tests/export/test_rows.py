"""Numbers as text: the digits that give them back, and lines that solvers can read."""

import io

import numpy as np
import pytest

from gpubspline.export import rows

SIZES = 10.0 ** np.arange(-37, 38)


def written(write, *arguments):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", newline="\n")
    stream.write("*BEFORE\n")
    write(stream, *arguments)
    stream.write("*AFTER\n")
    stream.flush()
    lines = stream.buffer.getvalue().decode().splitlines()
    assert lines[0] == "*BEFORE"
    assert lines[-1] == "*AFTER"
    return lines[1:-1]


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_every_size_of_number_comes_back(real):
    rng = np.random.default_rng(2)
    values = (rng.uniform(-1, 1, (50, SIZES.size)) * SIZES).astype(real).ravel()
    values[:4] = [0, -0.0, np.finfo(real).tiny, np.finfo(real).max]
    lines = [line.split(",") for line in written(rows.write_reals, [values, values[::-1]])]
    assert [int(line[0]) for line in lines] == list(range(1, values.size + 1))
    assert max(len(word) for line in lines for word in line) <= 20
    back = np.array([[float(word) for word in line[1:]] for line in lines]).T
    for given, wanted in ((back[0], values), (back[1], values[::-1])):
        if real is np.float32:
            np.testing.assert_array_equal(given.astype(np.float32), wanted)
        else:
            np.testing.assert_allclose(given, wanted, rtol=5.1e-12)
    assert rows.texts(values) == [line[1] for line in lines]


@pytest.mark.parametrize("chunk", [1, 7, 1000])
@pytest.mark.parametrize("width", [4, 8, 20])
def test_cells_have_labels_and_lines_of_at_most_sixteen(width, chunk, monkeypatch):
    monkeypatch.setattr(rows, "_CHUNK", chunk)
    cells = np.arange(30 * width, dtype=np.int32).reshape(30, width)
    lines = written(rows.write_cells, cells, 101)
    assert max(len(line.rstrip(",").split(",")) for line in lines) == min(width + 1, 16)
    whole = "\n".join(lines).replace(",\n", ",").splitlines()
    table = np.array([[int(word) for word in line.split(",")] for line in whole])
    np.testing.assert_array_equal(table, np.column_stack([np.arange(101, 131), cells + 1]))


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 100])
def test_members_fill_lines_of_sixteen(count, monkeypatch):
    monkeypatch.setattr(rows, "_CHUNK", 2)
    members = np.random.default_rng(3).permutation(count).astype(np.int32)
    lines = [line.split(",") for line in written(rows.write_members, members)]
    assert [int(word) for line in lines for word in line] == (members + 1).tolist()
    assert [len(line) for line in lines] == [16] * (count // 16) + [count % 16] * (count % 16 > 0)


def test_memory_is_that_of_a_chunk(monkeypatch):
    """Polars is never handed more rows than a chunk has."""
    import polars

    seen = []
    make = polars.DataFrame

    def recorded(columns):
        seen.append(len(next(iter(columns.values()))))
        return make(columns)

    monkeypatch.setattr(polars, "DataFrame", recorded)
    monkeypatch.setattr(rows, "_CHUNK", 50)
    written(rows.write_reals, [np.zeros(1234)])
    written(rows.write_cells, np.zeros((777, 8), dtype=np.int32), 1)
    assert max(seen) == 50
    assert sum(seen) == 1234 + 777
