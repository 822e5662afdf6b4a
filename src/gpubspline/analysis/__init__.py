"""Analysis: elasticity of a mesh under a load case, and its stress."""
