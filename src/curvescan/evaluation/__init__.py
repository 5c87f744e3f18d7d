"""How good a trajectory or a matcher is, against what is known to be true."""
