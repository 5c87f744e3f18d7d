"""The motion prior in a log: wheels or gyroscope, whether they agree with the scans, and poses that are no prior."""
