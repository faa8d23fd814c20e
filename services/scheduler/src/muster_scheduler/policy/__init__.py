"""Who does what and where: pure decisions over the core's state and the world, which become events themselves.

A decision is journaled like any other event, so replaying an old journal under newer policy gives the old state.
"""
