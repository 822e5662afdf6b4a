"""What the paper reports, figure by figure, and the models that its figures show.

Source: Pise, Bhatt, Srivastava, *Finite Element Mesh Generation of Human Body Segment in 2-D and 3-D Using B-spline
Method*. Its bones and its head were scanned; here they are the analytic phantoms of as many slices.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Model:
    """A mesh that the paper shows.

    Attributes
    ----------
    name: of its files and in the JSON.
    title: what it shows.
    phantom: which stands for the paper's scan.
    samples: along u, v and w.
    control: control points, or None for the default of the data.
    slice_index: of the slice that is meshed, or None for a solid.
    elements: that the paper counts.
    above_half, below_tenth: percent of the elements whose scaled Jacobian the paper has above 0.5 and below 0.1, as it
        words them.
    inverted: elements of no positive scaled Jacobian, or None where the paper does not say.
    """

    name: str
    title: str
    phantom: str
    samples: tuple[int, ...]
    control: tuple[int, ...] | None
    slice_index: int | None
    elements: int | None
    above_half: str = ""
    below_tenth: str = ""
    inverted: int | None = None


@dataclass(frozen=True)
class Figure:
    """A figure of the paper that is made again.

    Attributes
    ----------
    number: of the figure.
    caption: what the paper shows and says, in our words.
    models: by name, whose pictures it is made of.
    field: what colours them, or empty for a histogram of scaled Jacobians.
    """

    number: int
    caption: str
    models: tuple[str, ...]
    field: str = "HU"

    @property
    def name(self) -> str:
        """As it is asked for, and what its files begin with."""
        return f"fig{self.number}"


THRESHOLD_HU = {"head": -400.0}
"""Between air and skin: of a phantom that is meshed with its flesh; bones are found by Otsu's threshold."""

_MODELS = (
    Model("head-slice-fine", "head slice, Fig. 3a", "head", (140, 140), None, 20, 19321, "about 95", "", 0),
    Model("head-slice-coarse", "head slice, Fig. 3b", "head", (40, 70), None, 20, 2691),
    Model("child-slice", "child femur, slice", "child-femur", (30, 30), None, 20, None),
    Model("child", "child femur, Fig. 4a", "child-femur", (11, 18, 34), (11, 18, 34), None, 5610, "76", "10.5", 0),
    Model("adult-slice", "adult femur, slice", "adult-femur", (40, 40), None, 66, None),
    Model("adult", "adult femur, Fig. 4b", "adult-femur", (14, 24, 46), (14, 24, 46), None, 13455, "88", "1-2", 0),
    Model("head-slice", "head, slice", "head", (60, 60), None, 32, None),
    Model("head", "head, Fig. 4c", "head", (20, 80, 28), (20, 80, 28), None, 40527, "91", "1-2", 0),
    Model("adult-a", "adult femur, Fig. 5a", "adult-femur", (10, 10, 30), (10, 10, 30), None, 2349),
    Model("adult-b", "adult femur, Fig. 5b", "adult-femur", (14, 26, 46), (14, 26, 46), None, 14625),
    Model("adult-c", "adult femur, Fig. 5c", "adult-femur", (20, 20, 50), (20, 20, 50), None, 17689),
    Model("distal-slice", "adult femur, distal slice", "adult-femur", (30, 30), None, 2, None),
)

MODELS = {model.name: model for model in _MODELS}
"""Every mesh of the figures, in their order."""

TABLE = ("head-slice-fine", "head-slice-coarse", "child", "adult", "head", "adult-a", "adult-b", "adult-c")
"""Those that the paper gives figures of."""

FIGURES = (
    Figure(3, "One slice of the head, one surface, sampled at 140 x 140 and at 40 x 70 parameters; colour is HU.",
           ("head-slice-fine", "head-slice-coarse")),
    Figure(4, "A slice and the solid mesh of the child femur (34 slices), the adult femur (97) and the head (55).",
           ("child-slice", "child", "adult-slice", "adult", "head-slice", "head")),
    Figure(5, "One solid of the adult femur at three densities: 2,349, 14,625 and 17,689 elements.",
           ("adult-a", "adult-b", "adult-c")),
    Figure(6, "Scaled Jacobians of the head slice: all positive, about 95 % from 0.5 to 1.", ("head-slice-fine",), ""),
    Figure(7, "Scaled Jacobians of the child femur: all positive, 76 % above 0.5, 10.5 % below 0.1.", ("child",), ""),
    Figure(8, "Scaled Jacobians of the adult femur: all positive, 88 % above 0.5, 1 to 2 % poor.", ("adult",), ""),
    Figure(9, "Scaled Jacobians of the head: all positive, 91 % above 0.5, 1 to 2 % poor.", ("head",), ""),
    Figure(10, "A distal slice of the adult femur: HU, and Young's modulus at each node of its mesh.",
           ("distal-slice",), "HU E_MPa"),
    Figure(11, "The adult proximal femur: HU, and Young's modulus at each node.", ("adult",), "HU E_MPa"),
)  # fmt: skip
"""Those made of meshes; Fig. 13 is the study, Figs. 1, 2 and 12 are drawings."""

STUDY = "fig13"
"""As the study is asked for."""

STUDY_PHANTOM, STUDY_CONTROL, STUDY_CASE = "child-femur", (11, 18, 34), "stance"

STUDY_SAMPLES = (
    (10, 11, 16),
    (12, 12, 18),
    (14, 14, 19),
    (15, 15, 23),
    (17, 17, 25),
    (19, 19, 28),
    (21, 21, 31),
    (23, 23, 34),
    (24, 25, 36),
    (25, 26, 38),
    (26, 28, 41),
)
"""The study's 11 models: 1,350, ... 12,000, 15,972, ... 27,000 elements, each finer than the last along u, v and w.

The paper gives the counts 1,350, 12,000, 15,800 (rounded, or of a mesh that no near-cubic elements make: its factor is
79), 22,000 and 27,000, and no samples.
"""

STUDY_CHANGES = {"12,000 to 15,800": 2.1, "then": 0.5}
"""Percent, of the maximum von Mises stress."""
