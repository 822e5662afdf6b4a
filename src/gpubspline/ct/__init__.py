"""Computed tomography: files to a ``Volume`` of HU samples, and a ``Volume`` to the ``Region`` to be meshed."""
