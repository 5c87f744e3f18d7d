"""Figures of matches, trajectories and maps. Matplotlib is loaded when the first figure is drawn."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules={"plot"})
