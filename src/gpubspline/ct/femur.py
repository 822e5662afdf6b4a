"""An analytic proximal femur: shaft, neck, head and trochanters; cortical shell, cancellous core, marrow canal."""

from dataclasses import dataclass

import numpy as np

from gpubspline.ct.bodies import Body, Floats, Layer, blend, cone, ellipsoid, ramp, sphere

WATER_HU = 0.0  # an excised bone is scanned in a water bath
MARROW_HU = -30.0  # fatty marrow
CANCELLOUS_HU = 320.0
CORTICAL_HU = 1450.0  # below the 1630 that the paper takes for the densest cortical bone


@dataclass(frozen=True)
class Femur:
    """Measures of a left proximal femur; the origin lies on the shaft's axis, z up, the neck towards -y.

    The bone lies in the scanner with its neck in the vertical plane: image columns run from head to trochanter.

    Attributes
    ----------
    length: mm, from the plane z = 0, where the scan cuts the shaft, to the top of the head.
    head_radius: mm.
    offset: mm, of the head's centre from the shaft's axis.
    neck_angle: degrees, between neck and shaft.
    neck_radius: mm, at its narrowest.
    shaft: semi-axes in mm across and along the neck's plane, at z = 0.
    cortex: mm, thickness of the shell in the shaft and in the head.
    trochanter: 1 for the greater trochanter of an adult, less for one that is not yet grown.
    """

    length: float
    head_radius: float
    offset: float
    neck_angle: float
    neck_radius: float
    shaft: tuple[float, float]
    cortex: tuple[float, float]
    trochanter: float

    @property
    def head_centre(self) -> tuple[float, float, float]:
        """Centre of the head, mm."""
        return (0.0, -self.offset, self.length - self.head_radius)

    @property
    def neck_base(self) -> tuple[float, float, float]:
        """Where the axes of neck and shaft meet, mm."""
        return (0.0, 0.0, self.head_centre[2] - self.offset / np.tan(np.radians(180 - self.neck_angle)))
