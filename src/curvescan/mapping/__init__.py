"""From poses to maps: what the scans of a drive, laid at their poses, say of the place."""
