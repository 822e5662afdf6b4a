"""The devices of this machine."""

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import RunOptions


@command(KNOW, "backends")
def backends() -> None:
    """List the devices that kernels can run on."""
    from gpubspline.device import list_devices, open_device

    rows, chosen = list_devices(), open_device().name
    width = max(len(name) for name, _ in rows)
    marked = [f"{'*' if name == chosen else ' '} {name:{width}}  {words}" for name, words in rows]
    RunOptions().say([*marked, "* chosen by --backend auto"])
