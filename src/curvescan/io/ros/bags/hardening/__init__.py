"""What rosbags' readers lack: limits for what a file claims, and what is left of a bag that was cut short.

Nothing in here knows of scans, and only bag.py uses it: rosbags may take it over.
"""
