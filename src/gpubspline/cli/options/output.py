"""The files of a run: checked before the work, written after it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.deck import DeckOptions
from gpubspline.cli.options.groups import option
from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_writable

MeshFile = Annotated[
    Path,
    option(
        "Output",
        "mesh or deck, by extension (docs/formats.md)",
        "--output",
        "-o",
        metavar="FILE",
        show_default=False,
    ),
]

MADE_FIELDS = ("density_g_cm3", "E_MPa", "nu", "material", "scaled_jacobian")
"""Fields that a mesh gets beside the channels of its patch."""


@dataclass
class OutputOptions:
    """The files a run writes: checked before the work, written after it."""

    output: MeshFile
    summary: Annotated[Path | None, option("Output", "figures of the run, .json", metavar="FILE")] = None
    picture: Annotated[Path | None, option("Output", "picture of the mesh, .png", metavar="FILE")] = None
    field: Annotated[
        str, option("Output", "field that colours the picture, or the beginning of one", metavar="NAME")
    ] = "HU"
    histogram: Annotated[Path | None, option("Output", "scaled Jacobians, .png", metavar="FILE")] = None
    allow_inverted: Annotated[
        bool, option("Output", "write a mesh with inverted elements, too", "--allow-inverted")
    ] = False

    _deck = DeckOptions()
    _streamed = False  # whether the mesh was written while it was made

    @property
    def paths(self) -> list[Path]:
        """Every file that is asked for."""
        return [path for path in (self.output, self.summary, self.picture, self.histogram) if path]

    def check(self, inputs: Sequence[Path] = (), deck: DeckOptions | None = None) -> None:
        """Raise InputError where a file could not be written, or would replace another or one of the inputs."""
        from gpubspline.report.sheet import check_png
        from gpubspline.report.summary import check_json

        self._deck = deck or DeckOptions()
        self._deck.check(self.output)
        for path in self.paths:
            check_writable(path)
        check_apart(self.paths, [*inputs, *self._deck.inputs])
        for path in filter(None, (self.picture, self.histogram)):
            check_png(path)
        if self.summary:
            check_json(self.summary)

    def structured(self, deck: DeckOptions) -> bool:
        """Whether the output is of a format that holds structured meshes only."""
        from gpubspline.export import find_format

        return find_format(self.output, deck.format).name == "vts"

    def check_elements(self, sampling: Any, dimension: int) -> None:
        """Raise InputError where the format does not hold the elements that are asked for."""
        from gpubspline.export import find_format
        from gpubspline.mesh.sample import BY_ORDER

        known = self._deck.format or self.output.suffix.lower()
        element = sampling.element_type or BY_ORDER.get((dimension, sampling.order))
        if element is not None:  # what is no element at all is said where it is made
            find_format(self.output, self._deck.format).check_elements(known, element)

    def check_field(self, channels: Iterable[str], labelled: bool = False) -> None:
        """Take the picture's field by the beginning of its name; raise InputError where the mesh will not have it.

        A mesh without HU has no material: its picture shows the scaled Jacobian unless told otherwise.
        ``labelled`` is whether its elements have labels.
        """
        from gpubspline.report.quantity import find_field

        made = MADE_FIELDS if "HU" in channels else ("scaled_jacobian",)
        known = (*channels, *made, *(["label"] if labelled else []))
        if self.field == "HU" and "HU" not in known:
            self.field = "scaled_jacobian"
        if self.picture:
            try:
                self.field = find_field(known, self.field)
            except InputError:
                words = f"expected one of the fields {', '.join(known)} for --field, got {self.field!r}"
                raise InputError(words) from None

    def make(self, patch: Any, sampling: Any, device: Any, clock: Any, body: Any = None) -> Any:
        """Sample the patch; a ``.vts`` of a solid is written on the way, slab by slab."""
        from gpubspline import pipeline
        from gpubspline.streaming import stream_patch

        labelled = body is not None and body.labels is not None
        self.check_field(patch.channels, labelled)
        self.check_elements(sampling, patch.parametric_dimension)
        if sampling.mapping.transverse is not None:
            self._deck.check_orthotropy(self.output)
        first_order = sampling.order == 1 and sampling.element_type in (None, "hex8")
        whole = sampling.mapping.how != "nodal" or sampling.mapping.surface_depth_mm is not None
        whole = whole or labelled or sampling.optimize
        solid = patch.parametric_dimension == 3 and first_order
        self._streamed = self.output.suffix.lower() == ".vts" and solid and not whole and self._deck.plain
        if self._streamed:
            return stream_patch(patch, sampling, self.output, device, clock, body, self.allow_inverted)
        return pipeline.sample_patch(patch, sampling, device, clock, body)

    def write(self, model: Any, figures: dict[str, Any], clock: Any) -> None:
        """Write what is not written yet.

        Raises MeshError, and writes nothing, where elements are inverted and that was not allowed.
        """
        from gpubspline.export import write
        from gpubspline.report.histogram import write_histogram
        from gpubspline.report.picture import write_picture
        from gpubspline.report.summary import write_summary

        if not self.allow_inverted:
            model.counted.quality.check()
        if not self._streamed:
            with clock.stage("write"):
                figures["deck"] = write(model, self.output, law=model.laws, **self._deck.how())
        if self.picture:
            with clock.stage("picture"):
                write_picture(model.mesh, self.picture, field=self.field)
        if self.histogram:
            write_histogram(model.counted.quality, self.histogram)
        if self.summary:
            figures["seconds"] = {**clock.seconds, "total": sum(clock.seconds.values())}
            write_summary(figures, self.summary)
