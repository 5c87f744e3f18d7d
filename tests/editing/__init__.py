"""Maps edited by hand or by rule."""
