"""Live: a source of scans -> odometry or SLAM -> sinks. Names are loaded on first use, so that --help loads no kernel.

The source runs in a thread of its own, the tracker in the caller's, each sink in one of its own: nothing that is slow
to draw or to write delays a pose.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
