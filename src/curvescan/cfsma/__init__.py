"""CF-SMA, the paper's method, one file a stage in the paper's order.

P. Núñez, R. Vázquez-Martín, A. Bandera, F. Sandoval, "Fast laser scan matching approach based on
adaptive curvature estimation for mobile robots", Robotica 27 (2009) 469-479.
"""
