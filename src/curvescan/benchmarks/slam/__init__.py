"""Loop closures, localization, long runs and large graphs, on simulated floors and real logs."""
