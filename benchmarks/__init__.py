"""Measurements of a whole Muster against its bars; `make bench` runs them all."""
