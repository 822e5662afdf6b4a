"""Whether the script that asks for worker processes can be imported by them without asking again."""

import ast
import sys
from pathlib import Path
from types import FrameType

from gpubspline.errors import InputError


def check_guard() -> None:
    """Raise InputError where this is called by the main script as that is read, outside ``if __name__ == ...``.

    Processes that are spawned import the main script first, as ``multiprocessing`` explains under "Safe importing of
    main module": each would start a cluster of its own. A notebook, ``python -c`` and a console have no such script.
    """
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    frame: FrameType | None = sys._getframe()
    while frame is not None and not (frame.f_globals is vars(main) and frame.f_code.co_name == "<module>"):
        frame = frame.f_back
    if frame is None or script is None:
        return
    try:
        tree = ast.parse(Path(script).read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):  # not to be judged: a zip, an archive, or no longer there
        return
    if not _is_guarded(tree, frame.f_lineno):
        raise InputError(
            f'expected worker processes to be asked for below if __name__ == "__main__":, got line {frame.f_lineno} of '
            f"{Path(script).name}, which each of them would run again"
        )


def _is_guarded(tree: ast.Module, line: int) -> bool:
    """Whether a line lies in, or after, a statement that asks for the name of the module."""
    asking = (node for node in tree.body if isinstance(node, ast.If) and "__name__" in ast.unparse(node.test))
    return any(node.lineno <= line for node in asking)
