"""Patient-specific finite element models from CT: B-spline solids sampled to all-hexahedral meshes with material."""

from gpubspline.errors import BackendUnavailable as BackendUnavailable
from gpubspline.errors import GpubsplineError as GpubsplineError
from gpubspline.errors import GpubsplineWarning as GpubsplineWarning
from gpubspline.errors import InputError as InputError
