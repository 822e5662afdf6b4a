"""All-hexahedral meshes of any topology: lattice cells inside the region, a layer of hexes out to its surface."""
