"""Figures and result folders. Matplotlib is loaded when the first figure is drawn."""
