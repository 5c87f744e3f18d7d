"""Bags as files: opened, kept within limits, and read as far as they are sound."""
