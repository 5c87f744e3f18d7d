"""The jobs of the commands, as functions."""
