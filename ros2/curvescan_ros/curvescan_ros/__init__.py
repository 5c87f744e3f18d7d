"""curvescan_ros: a ROS 2 node around curvescan's odometry, SLAM and localization."""
