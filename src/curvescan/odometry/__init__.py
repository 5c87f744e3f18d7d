"""A stream of scans in, a trajectory out. Names are loaded on first use, so that --help loads no kernel."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
