"""What the matcher computes from one scan alone: segments, surfels, landmarks and the range image."""
