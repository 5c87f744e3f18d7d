"""curvescan: 2D laser scan matching, laser odometry and the tools around them.

Names are loaded on first use (PEP 562): ``import curvescan`` reads no file and imports neither NumPy,
Numba nor Matplotlib.

One rule for configurations: ``method=`` names a matcher, ``config=`` configures what is called (the matcher in
:func:`match`, the odometry in :class:`Odometry` and :func:`run`), and ``matcher=`` configures the matcher within. Each
takes an instance of its config class or a mapping of the fields that differ from the defaults.
"""

import lazy_loader

from curvescan._version import __version__ as __version__

# a new public name takes one line in __init__.pyi, `from .room.file import Name as Name`, and one in
# docs/reference/api.rst
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
