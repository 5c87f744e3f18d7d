"""The default matcher: keypoints propose poses, both scans score them, point-to-line least squares refines them."""
