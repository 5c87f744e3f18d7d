"""Localization in a saved map: distance field, search without a guess, matches that measure the pose."""
