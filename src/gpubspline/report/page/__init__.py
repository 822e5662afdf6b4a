"""The report: one page that opens without a network, made from a plain account of a run."""

from gpubspline.report.page.account import Account as Account
from gpubspline.report.page.account import Curve as Curve
from gpubspline.report.page.account import Setting as Setting
from gpubspline.report.page.account import Table as Table
from gpubspline.report.page.write import check_page as check_page
from gpubspline.report.page.write import write_report as write_report
