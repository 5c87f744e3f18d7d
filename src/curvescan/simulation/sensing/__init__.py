"""What a laser sees: its beams and errors, the walls that they meet, the people who walk through them."""
