"""Where several batches meet: buckets, claims on logs in them, and locks on files."""
