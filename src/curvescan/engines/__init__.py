"""Odometry, SLAM or localization over whole logs, of one laser or of a rig. Names are loaded on first use."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
