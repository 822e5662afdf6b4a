"""The options of the command line, a group a file."""

from gpubspline.cli.options.deck import DeckOptions as DeckOptions
from gpubspline.cli.options.groups import flattened as flattened
from gpubspline.cli.options.method import MethodOptions as MethodOptions
from gpubspline.cli.options.output import OutputOptions as OutputOptions
from gpubspline.cli.options.read import ReadOptions as ReadOptions
from gpubspline.cli.options.region import RegionOptions as RegionOptions
from gpubspline.cli.options.report import ReportOptions as ReportOptions
from gpubspline.cli.options.run import RunOptions as RunOptions
from gpubspline.cli.options.sampling import SamplingOptions as SamplingOptions
from gpubspline.cli.options.solve import SolveOptions as SolveOptions
from gpubspline.cli.options.spline import SplineOptions as SplineOptions
from gpubspline.cli.options.study import StudyOptions as StudyOptions
