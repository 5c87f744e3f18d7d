"""How good a trajectory is: ATE, RPE, drift and relations, against reference poses."""
