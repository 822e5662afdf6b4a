"""The command line: ``commands`` holds one a file, ``options`` the groups of options that they share."""

from gpubspline.cli.app import app as app
from gpubspline.cli.entry import main as main
