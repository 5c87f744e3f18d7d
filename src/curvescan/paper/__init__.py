"""The paper's calibration and experiments, with its figures and tables."""
