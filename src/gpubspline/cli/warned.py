"""What the user is warned of: a line on stderr at once, and kept for the report of the run."""

import typer

_SAID: list[str] = []


def warn(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning, in the place of ``warnings.showwarning``."""
    line = one_line(str(message))
    _SAID.append(line)
    typer.echo(f"gpubspline: warning: {line}", err=True)


def forget() -> None:
    """Begin a run in which nothing was said yet."""
    _SAID.clear()


def said() -> list[str]:
    """What was said in this run, in its order."""
    return list(_SAID)


def one_line(text: str) -> str:
    """Give a text without line breaks."""
    return " ".join(text.split())
