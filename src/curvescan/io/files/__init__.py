"""What all readers and writers share: lines, limits, decompression, atomic output."""
