"""Speed and accuracy of the matchers on simulated pairs, and their report."""
