"""Scans, odometry and transforms written as ROS bags."""
