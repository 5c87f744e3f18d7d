"""Localization in a saved map: the map as a field of distances, the search without a guess, the matches that measure the pose."""
