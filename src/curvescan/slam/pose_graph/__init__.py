"""The pose graph: nodes and edges, the start, the optimum, its covariances, and which edges are consistent."""
