"""Figures of matches, trajectories and maps. Matplotlib is loaded when the first figure is drawn."""
