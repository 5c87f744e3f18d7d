"""What the matcher computes from one scan alone: segments, surfels, keypoints and the range image."""
