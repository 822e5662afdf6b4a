"""From HU to density, Young's modulus and Poisson's ratio."""
