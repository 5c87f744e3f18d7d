"""What speaks for a refined pose: a label for each reading, the information of the matched lines, and the confidence."""
