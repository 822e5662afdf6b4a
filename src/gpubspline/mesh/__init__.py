"""Finite element meshes: sampling a hyperpatch, quality, distance to the region."""
