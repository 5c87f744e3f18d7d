"""The default matcher's stages: features of one scan, pose hypotheses, their verification, refinement, covariance."""
