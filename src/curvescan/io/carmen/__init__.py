"""CARMEN logs, the text format of the classic 2D SLAM data sets."""
