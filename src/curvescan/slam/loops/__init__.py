"""Loop closures: where they are searched, which matches agree, and which bend the odometry more than it can err."""
