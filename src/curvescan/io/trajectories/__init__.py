"""Trajectories, pose graphs and relations as files."""
