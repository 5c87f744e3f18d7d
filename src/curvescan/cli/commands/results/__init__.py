"""Commands on what other commands wrote: look at results, change maps."""
