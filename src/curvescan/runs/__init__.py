"""One function a job: a log in, a folder of results out; what the commands call."""
