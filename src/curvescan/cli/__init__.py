"""The command line: `main` finds a command; what the commands share stands beside it, they themselves in commands/."""
