"""The commands, in the order of the help: the import of each joins it to the application."""

# ruff: noqa: I001
from gpubspline.cli.commands import info as info
from gpubspline.cli.commands import preview as preview
from gpubspline.cli.commands import mesh as mesh
from gpubspline.cli.commands import fit as fit
from gpubspline.cli.commands import sample as sample
from gpubspline.cli.commands import quality as quality
from gpubspline.cli.commands import view as view
from gpubspline.cli.commands import optimize as optimize
from gpubspline.cli.commands import solve as solve
from gpubspline.cli.commands import study as study
from gpubspline.cli.commands import export as export
from gpubspline.cli.commands import batch as batch
from gpubspline.cli.commands import laws as laws
from gpubspline.cli.commands import backends as backends
from gpubspline.cli.commands import phantom as phantom
from gpubspline.cli.commands import demo as demo
from gpubspline.cli.commands import reproduce as reproduce
from gpubspline.cli.commands import bench as bench
