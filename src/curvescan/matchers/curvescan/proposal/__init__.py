"""Poses without a guess: hypotheses of rotation and translation, scored, the best ones refined."""
