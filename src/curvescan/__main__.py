"""``python -m curvescan`` is the command ``curvescan``."""

from curvescan.cli.main import main

main()
