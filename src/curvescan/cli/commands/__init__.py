"""The commands, one a file: each is a function whose signature makes the flags and whose docstring makes the help."""
