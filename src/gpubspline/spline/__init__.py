"""B-spline mathematics: knots, control lattices, hyperpatches and their fit."""
