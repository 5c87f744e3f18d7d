"""Maps edited by hand or by rule: pure functions from maps to maps."""
