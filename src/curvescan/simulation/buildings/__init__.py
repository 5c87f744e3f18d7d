"""Rooms, corridors, offices and whole floors as exact walls and arcs, and the table of their names."""
