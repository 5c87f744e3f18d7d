"""What rosbags leaves to its caller: limits for files that claim too much, and what is left of broken bags."""
