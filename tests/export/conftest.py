"""The femur and the load case of ``foreign.models``, as fixtures."""

import pytest

from foreign import models
from gpubspline.analysis.load_case import LoadCase
from gpubspline.mesh.mesh import Mesh


@pytest.fixture(scope="session")
def femur() -> Mesh:
    """A coarse femur of 220 hex8."""
    return models.femur(1)


@pytest.fixture(scope="session")
def femur20() -> Mesh:
    """It as 220 hex20."""
    return models.femur(2)


@pytest.fixture(scope="session")
def all_loads() -> LoadCase:
    """A force, a pressure on whole faces and one on parts of faces, gravity, and a support that moves."""
    return models.all_loads()
