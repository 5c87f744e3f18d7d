"""The default matcher: walls and edges propose poses, scans score them, point-to-line least squares refines them."""
