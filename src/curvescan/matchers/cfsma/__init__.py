"""CF-SMA, the paper's matcher, one file a stage in the paper's order."""
