"""What is in a log and what is wrong with it: statistics, checks, beam order and rotation direction."""
