"""One job over many logs: a supervisor, its worker processes, and the manifest of what is done."""
