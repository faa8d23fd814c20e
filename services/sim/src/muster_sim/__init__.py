"""The site in pybullet: robots, soil, puddles, obstacles, UAV cameras."""
