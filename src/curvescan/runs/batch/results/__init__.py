"""Where the results of a batch go, a folder or a bucket, and the record of what became of each log."""
