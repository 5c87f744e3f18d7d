"""What speaks for a refined pose: labels of readings, information of matched lines, confidence."""
