"""ROS 1 and ROS 2 bags: scans, odometry, transforms and gyroscopes, read and written without ROS."""
