"""Owns missions: graph, assignment, dispatch, failure policy, journal."""
