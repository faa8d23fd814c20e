"""Muster's shared language: ids, models, the channel table, the skill catalogue and the plan gate.

This package imports nothing else of Muster and nothing of Zenoh; every other package imports it.
"""
