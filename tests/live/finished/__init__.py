"""The page of finished runs."""
