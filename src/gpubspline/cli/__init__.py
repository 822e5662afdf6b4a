"""The command line: ``commands`` holds one a file, ``options`` the groups of options that they share."""

import sys

INTERRUPTED = 130
"""Exit status of a process that Ctrl-C ended, as shells have it: 128 and the number of the signal."""


def main() -> None:
    """Run the command line; an interrupt while it still loads is one line, as a later one is."""
    try:
        from gpubspline.cli import entry

        entry.run()
    except KeyboardInterrupt:
        sys.stderr.write("gpubspline: error: interrupted\n")
        raise SystemExit(INTERRUPTED) from None
