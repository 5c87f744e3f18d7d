"""How a robot drives: where to, along which way, how fast, and what its wheels measure of it."""
