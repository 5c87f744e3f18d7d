"""Drivers: lasers on a serial port or a network, through the packages of the extra ``curvescan[lidar]``."""
