"""meshio without its words on the terminal."""

import contextlib
import io
from collections.abc import Iterator


@contextlib.contextmanager
def quiet_meshio() -> Iterator[io.StringIO]:
    """Keep what meshio prints; what a format cannot hold is known beforehand and said once, by a warning."""
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
        yield heard
