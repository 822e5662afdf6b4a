"""The paper's whole set of results, made again on the phantoms: its tables' figures, its pictures, its study."""
